"""Plans from any state to any target, for one axis and for many."""

from sjerk.planner.arguments import (
    Synchronization,
    check_target,
    code_of,
    cycles_of,
    moving_of,
)
from sjerk.planner.batch import Plans, plan_many
from sjerk.planner.planning import Motion, plan, plan_velocity
from sjerk.planner.updating import Step, Updater

__all__ = [
    "Motion",
    "Plans",
    "Step",
    "Synchronization",
    "Updater",
    "check_target",
    "code_of",
    "cycles_of",
    "moving_of",
    "plan",
    "plan_many",
    "plan_velocity",
]
