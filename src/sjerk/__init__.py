"""sjerk: a motion kernel. Jerk-limited s-curves in whole control cycles, exact to the last bit."""

from sjerk.errors import InfeasibleError, InputError, SjerkError
from sjerk.profile import Extrema, Limits, Phase, Profile, Range, Samples, State, scurve

__all__ = [
    "Extrema",
    "InfeasibleError",
    "InputError",
    "Limits",
    "Phase",
    "Profile",
    "Range",
    "Samples",
    "SjerkError",
    "State",
    "scurve",
]
