"""The protocols of the dual-port RAM as small machines, and a search through all their runs.

Written from the protocols, not from the C: one action per load or store of a shared word, a
payload of two halves. Every machine may be killed before any of its actions and begins again as the
real side does. The model is sequentially consistent; that the C orders its stores as the model does
is the business of ThreadSanitizer and of handshake_steps.c.

Each protocol has a broken twin, so that the search is seen to be able to find something.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from typing import Any, NamedTuple

State = Any
Successors = Callable[[Any], Iterable[Any]]


class ViolationError(AssertionError):
    """A state that must not be; ``steps`` is the shortest way to it."""

    def __init__(self, what: str, steps: int) -> None:
        super().__init__(f"{what}, after {steps} steps")
        self.steps = steps


def explore(start: State, successors: Successors, wrong: Callable[[Any], str | None]) -> int:
    """Visit every reachable state, nearest first; the number of states. Raises ViolationError."""
    seen = {start}
    front = [start]
    steps = 0
    while front:
        following = []
        for state in front:
            what = wrong(state)
            if what:
                raise ViolationError(f"{what}: {state}", steps)
            for new in successors(state):
                if new not in seen:
                    seen.add(new)
                    following.append(new)
        front = following
        steps += 1
    return len(seen)


def put(slots: tuple[Any, ...], at: int, value: Any) -> tuple[Any, ...]:
    """The tuple with one entry replaced."""
    return (*slots[:at], value, *slots[at + 1 :])


# ---- command: three slots and one word ----------------------------------------------------------


def word(w: int, m: int, r: int, fresh: int) -> int:
    """The word as the contract writes it."""
    return w | m << 2 | r << 4 | fresh << 6


LEGAL = {
    word(w, m, 3 - w - m, fresh) for w in range(3) for m in range(3) if w != m for fresh in range(2)
}


def published(value: int) -> int:
    """The word after the host has exchanged w and m."""
    return word(value >> 2 & 3, value & 3, value >> 4 & 3, 1)


def collected(value: int) -> int:
    """The word after the kernel has exchanged m and r; the same if nothing is fresh."""
    return word(value & 3, value >> 4 & 3, value >> 2 & 3, 0) if value >> 6 else value


class Slot(NamedTuple):
    """A stamp and the two halves of a payload."""

    number: int = 0
    epoch: int = 0  # of the kernel it is meant for
    a: Any = 0
    b: Any = 0


class Command(NamedTuple):
    """Shared memory, both sides' registers, and what a bystander knows (ghosts)."""

    word: int = word(0, 1, 2, 0)
    slots: tuple[Slot, ...] = (Slot(), Slot(), Slot())
    published: int = 0
    addressed: int = 0
    epoch: int = 0
    taken: int = 0
    host: tuple[Any, ...] = ("idle",)
    kernel: tuple[Any, ...] = ("idle",)
    host_kills: int = 0
    kernel_kills: int = 0
    done: int = 0  # ghost: the last command wholly published
    bad: str = ""


def command_successors(
    most: int, kills: int, *, clear_last: bool = False, stamped: bool = True
) -> Successors:
    """``clear_last``, not ``stamped``: broken twins of the restart."""

    def host(s: Command) -> Iterator[Command]:
        match s.host:
            case ("idle",):
                if s.published < most:
                    yield s._replace(host=("check",))
                if s.addressed != s.epoch:
                    yield s._replace(addressed=s.epoch)
            case ("check",):  # KERNEL_RESTARTED, or go on
                yield s._replace(host=("load",) if s.addressed == s.epoch else ("idle",))
            case ("load",):
                yield s._replace(host=("number", s.word))
            case ("number", old):
                yield s._replace(published=s.published + 1, host=("stamp", old, s.published + 1))
            case ("stamp", old, n):
                slot = s.slots[old & 3]._replace(number=n, epoch=s.addressed)
                yield s._replace(slots=put(s.slots, old & 3, slot), host=("a", old, n))
            case ("a", old, n):
                slot = s.slots[old & 3]._replace(a=n)
                yield s._replace(slots=put(s.slots, old & 3, slot), host=("b", old, n))
            case ("b", old, n):
                slot = s.slots[old & 3]._replace(b=n)
                yield s._replace(slots=put(s.slots, old & 3, slot), host=("cas", old, n))
            case ("cas", old, n):
                if s.word == old:
                    yield s._replace(word=published(old), done=n, host=("idle",))
                else:
                    yield s._replace(host=("cas", s.word, n))
            case ("begin",):
                yield s._replace(addressed=s.epoch, host=("idle",))
        if s.host_kills < kills:
            yield s._replace(host=("begin",), host_kills=s.host_kills + 1)

    def kernel(s: Command) -> Iterator[Command]:
        match s.kernel:
            case ("idle",):
                yield s._replace(kernel=("cas", s.word))
            case ("cas", old):
                if not old >> 6:
                    yield s._replace(kernel=("idle",))
                elif s.word == old:
                    yield s._replace(word=collected(old), kernel=("stamp", old >> 2 & 3))
                else:
                    yield s._replace(kernel=("cas", s.word))
            case ("stamp", r):
                slot = s.slots[r]
                stale = stamped and slot.epoch < s.epoch
                yield s._replace(kernel=("idle",) if stale else ("a", r, slot.number, slot.epoch))
            case ("a", r, n, epoch):
                yield s._replace(kernel=("b", r, n, epoch, s.slots[r].a))
            case ("b", r, n, epoch, a):
                bad = ""
                if not a == s.slots[r].b == n:
                    bad = "torn"
                elif n <= s.taken:
                    bad = "backwards"
                elif epoch != s.epoch:
                    bad = "meant for another kernel"
                yield s._replace(kernel=("idle",), taken=n, bad=bad)
            case ("begin",):
                yield s._replace(kernel=("epoch",) if clear_last else ("clear",))
            case ("clear",):
                following = ("idle",) if clear_last else ("epoch",)
                yield s._replace(word=s.word & ~64, kernel=following)
            case ("epoch",):
                following = ("clear",) if clear_last else ("idle",)
                yield s._replace(epoch=s.epoch + 1, kernel=following)
        if s.kernel_kills < kills:
            yield s._replace(kernel=("begin",), kernel_kills=s.kernel_kills + 1)

    return lambda s: (*host(s), *kernel(s)) if not s.bad else ()


def command_wrong(s: Command) -> str | None:
    """Torn, backwards, for another kernel; or published to this kernel and nowhere."""
    if s.bad:
        return s.bad
    if s.word not in LEGAL:
        return "illegal word"
    waiting = s.slots[s.word >> 2 & 3]
    if (
        s.kernel == ("idle",)
        and s.host == ("idle",)
        and s.addressed == s.epoch
        and s.done > s.taken
        and any(slot.number == s.done and slot.epoch == s.epoch for slot in s.slots)
        and not (s.word >> 6 and waiting.number == s.done)
    ):
        return "lost"
    return None


class Exchange(NamedTuple):
    """The broken twin: each side keeps its index to itself, and guesses after a restart."""

    middle: int = 1
    fresh: int = 0
    slots: tuple[Slot, ...] = (Slot(), Slot(), Slot())
    value: int = 0
    w: int = 0
    r: int = 2
    host: str = "a"
    kernel: tuple[Any, ...] = ("swap",)
    bad: str = ""


def exchange_successors(s: Exchange) -> Iterator[Exchange]:
    """One exchange with the middle slot per side; kills put w to 0 and r to 2 again."""
    if s.bad:
        return
    if s.host == "a":
        slot = s.slots[s.w]._replace(a=s.value)
        yield s._replace(slots=put(s.slots, s.w, slot), host="b")
    elif s.host == "b":
        slot = s.slots[s.w]._replace(b=s.value)
        yield s._replace(slots=put(s.slots, s.w, slot), host="swap")
    else:
        yield s._replace(middle=s.w, w=s.middle, fresh=1, value=1 - s.value, host="a")
    if s.kernel == ("swap",):
        if s.fresh:
            yield s._replace(middle=s.r, r=s.middle, fresh=0, kernel=("a",))
    elif s.kernel == ("a",):
        yield s._replace(kernel=("b", s.slots[s.r].a))
    else:
        torn = s.kernel[1] != s.slots[s.r].b
        yield s._replace(kernel=("swap",), bad="torn" if torn else "")
    yield s._replace(host="a", w=0)
    yield s._replace(kernel=("swap",), r=2, fresh=0)


# ---- latched slots: feedback and events ---------------------------------------------------------

LATCH_SLOTS = 3


class Latch(NamedTuple):
    """A writer that may be killed, and one reader. A payload is (number, life of the writer)."""

    count: int = 0
    slots: tuple[Slot, ...] = (Slot(),) * LATCH_SLOTS
    writer: tuple[Any, ...] = ("idle",)
    reader: tuple[Any, ...] = ("idle",)
    seen: int = 0
    kills: int = 0
    bad: str = ""


def latch_successors(most: int, kills: int, *, mark: bool = True) -> Successors:
    """Not ``mark``: the broken twin, which does not put 0 into the number before it writes."""

    def at(s: Latch) -> int:
        return (s.count + 1) % LATCH_SLOTS

    def change(s: Latch, following: tuple[Any, ...], **fields: Any) -> Latch:
        return s._replace(
            slots=put(s.slots, at(s), s.slots[at(s)]._replace(**fields)), writer=following
        )

    def writer(s: Latch) -> Iterator[Latch]:
        value = (s.count + 1, s.kills)
        match s.writer:
            case ("idle",):
                if s.count < most:
                    yield change(s, ("a",), number=0) if mark else s._replace(writer=("a",))
            case ("a",):
                yield change(s, ("b",), a=value)
            case ("b",):
                yield change(s, ("number",), b=value)
            case ("number",):
                yield change(s, ("count",), number=s.count + 1)
            case ("count",):
                yield s._replace(count=s.count + 1, writer=("idle",))
        if s.kills < kills:
            yield s._replace(writer=("idle",), kills=s.kills + 1)

    def reader(s: Latch) -> Iterator[Latch]:
        match s.reader:
            case ("idle",):
                if s.count:
                    yield s._replace(reader=("number", s.count))
            case ("number", n):
                whole = s.slots[n % LATCH_SLOTS].number == n
                yield s._replace(reader=("a", n) if whole else ("idle",))
            case ("a", n):
                yield s._replace(reader=("b", n, s.slots[n % LATCH_SLOTS].a))
            case ("b", n, a):
                yield s._replace(reader=("again", n, a, s.slots[n % LATCH_SLOTS].b))
            case ("again", n, a, b):
                bad = ""
                if s.slots[n % LATCH_SLOTS].number == n:
                    if a != b or a[0] != n:
                        bad = "torn"
                    elif n < s.seen:
                        bad = "backwards"
                    yield s._replace(reader=("idle",), seen=n, bad=bad)
                else:
                    yield s._replace(reader=("idle",))

    return lambda s: (*writer(s), *reader(s)) if not s.bad else ()


def latch_wrong(s: Latch) -> str | None:
    """Torn, backwards; or the newest frame cannot be read, wherever the writer stands or died."""
    newest = s.slots[s.count % LATCH_SLOTS]
    if s.count and not (newest.number == s.count and newest.a == newest.b):
        return "the newest frame is not readable"
    return s.bad or None


# ---- ring ---------------------------------------------------------------------------------------

RING_SLOTS = 2


class Ring(NamedTuple):
    """A producer with batches and flushes, a consumer, both mortal."""

    head: int = 0
    tail: int = 0
    flush: int = 0
    slots: tuple[Slot, ...] = (Slot(),) * RING_SLOTS
    addressed: int = 0
    epoch: int = 0
    host: tuple[Any, ...] = ("idle",)
    kernel: tuple[Any, ...] = ("idle",)
    host_kills: int = 0
    kernel_kills: int = 0
    delivered: int = 0  # ghost: number of the last record the kernel got
    skippable: int = 0  # ghost: records up to here may have been discarded
    bad: str = ""


def ring_successors(
    most: int, kills: int, *, mark: bool = True, stamped: bool = True
) -> Successors:
    """Not ``mark``: a flush by counter, which takes what was published after it as well."""

    def host(s: Ring) -> Iterator[Ring]:
        match s.host:
            case ("idle",):
                for count in (1, 2):
                    if s.head + count <= most and s.head + count - s.tail <= RING_SLOTS:
                        yield s._replace(host=("check", count))
                if s.flush < s.head:
                    if mark:
                        yield s._replace(flush=s.head, skippable=max(s.skippable, s.head))
                    else:
                        yield s._replace(flush=-1, skippable=max(s.skippable, s.head))
                if s.addressed != s.epoch:
                    yield s._replace(addressed=s.epoch)
            case ("check", count):
                following = ("a", 0, count) if s.addressed == s.epoch else ("idle",)
                yield s._replace(host=following)
            case ("a", i, count):
                n = s.head + i + 1
                slot = s.slots[n % RING_SLOTS]._replace(
                    number=n, epoch=s.addressed, a=(n, s.host_kills)
                )
                yield s._replace(slots=put(s.slots, n % RING_SLOTS, slot), host=("b", i, count))
            case ("b", i, count):
                n = s.head + i + 1
                slot = s.slots[n % RING_SLOTS]._replace(b=(n, s.host_kills))
                following = ("a", i + 1, count) if i + 1 < count else ("head", count)
                yield s._replace(slots=put(s.slots, n % RING_SLOTS, slot), host=following)
            case ("head", count):
                # Records for a kernel that is gone will rightly be skipped.
                old = s.addressed != s.epoch
                skippable = s.head + count if old else s.skippable
                yield s._replace(head=s.head + count, skippable=skippable, host=("idle",))
            case ("begin",):
                yield s._replace(addressed=s.epoch, host=("idle",))
        if s.host_kills < kills:
            yield s._replace(host=("begin",), host_kills=s.host_kills + 1)

    def kernel(s: Ring) -> Iterator[Ring]:
        match s.kernel:
            case ("idle",):
                yield s._replace(kernel=("flush", s.flush))
            case ("flush", flush):
                yield s._replace(kernel=("skip", s.head if flush < 0 else flush, s.head))
            case ("skip", flush, head):
                tail = max(s.tail, flush)
                cleared = 0 if s.flush < 0 else s.flush
                yield s._replace(tail=tail, flush=cleared, kernel=("stamp", head, flush))
            case ("stamp", head, flush):
                slot = s.slots[(s.tail + 1) % RING_SLOTS]
                if s.tail == head:
                    yield s._replace(kernel=("idle",))
                elif stamped and slot.epoch < s.epoch:
                    yield s._replace(tail=s.tail + 1, kernel=("stamp", head, flush))
                else:
                    yield s._replace(kernel=("b", flush, slot.epoch, slot.a))
            case ("b", flush, epoch, a):
                n = s.tail + 1
                b = s.slots[n % RING_SLOTS].b
                yield s._replace(kernel=("tail", flush, epoch, a, b))
            case ("tail", flush, epoch, a, b):
                n = s.tail + 1
                bad = ""
                if a != b or a[0] != n:
                    bad = "torn"
                elif n <= flush:
                    bad = "delivered although flushed"
                elif epoch != s.epoch:
                    bad = "meant for another kernel"
                elif n <= s.delivered:
                    bad = "doubled"
                elif any(k > s.skippable for k in range(s.delivered + 1, n)):
                    bad = "lost"
                yield s._replace(tail=n, delivered=n, kernel=("idle",), bad=bad)
            case ("begin",):
                yield s._replace(kernel=("epoch",), tail=s.head, skippable=max(s.skippable, s.head))
            case ("epoch",):
                # What was published since the tail moved is addressed to the epoch that ends here.
                yield s._replace(
                    epoch=s.epoch + 1, kernel=("idle",), skippable=max(s.skippable, s.head)
                )
        if s.kernel_kills < kills:
            yield s._replace(kernel=("begin",), kernel_kills=s.kernel_kills + 1)

    return lambda s: (*host(s), *kernel(s)) if not s.bad else ()


def ring_wrong(s: Ring) -> str | None:
    """Torn, lost, doubled, out of order, flushed or misaddressed; or a tail beyond the head."""
    if not s.tail <= s.head <= s.tail + RING_SLOTS:
        return "head and tail apart"
    return s.bad or None


# ---- stop requests ------------------------------------------------------------------------------

STOP_SETS = STOP_AXES = 2


class Stops(NamedTuple):
    """One slot, its processes in turn, and the kernel. A request is (process, set, axis)."""

    sets: tuple[int, ...] = (0,) * STOP_SETS  # shared: axes to be halted, to be quick-stopped
    pid: int = 0  # shared: whose slot it is
    owner: int = 1  # the process that holds the lock of the slot
    requester: tuple[Any, ...] = ("claim", 0)
    kernel: tuple[Any, ...] = ("idle",)
    asked: frozenset[tuple[int, int, int]] = frozenset()  # ghost: made, and not taken
    made: int = 0
    requester_kills: int = 0
    kernel_kills: int = 0
    bad: str = ""


def stop_successors(
    most: int,
    kills: int,
    *,
    atomic: bool = True,
    exchanged: bool = True,
    patient: bool = True,
    named_first: bool = True,
    only_seen: bool = True,
) -> Successors:
    """Broken twins: a set that is loaded and stored (not ``atomic``), one that the kernel stores 0
    into after it has read it (not ``exchanged``), a claim beside a request that waits (not
    ``patient``), a kernel that asks whose slot it is after it has emptied it (not
    ``named_first``), one that empties a set that it has not seen to be filled before it asked
    (not ``only_seen``).
    """

    def requester(s: Stops) -> Iterator[Stops]:
        match s.requester:
            case ("claim", n):
                if patient and s.sets[n]:
                    yield s._replace(requester=("claim", 0))
                elif patient and n + 1 < STOP_SETS:
                    yield s._replace(requester=("claim", n + 1))
                else:
                    yield s._replace(pid=s.owner, requester=("idle",))
            case ("idle",):
                if s.made < most:
                    for n in range(STOP_SETS):
                        for axis in range(STOP_AXES):
                            yield s._replace(made=s.made + 1, requester=("or", n, axis))
            case ("or", n, axis):
                wanted = s.sets[n] | 1 << axis
                step = s._replace(requester=("store", n, axis, wanted))
                yield from requester(step) if atomic else (step,)
            case ("store", n, axis, wanted):
                yield s._replace(
                    sets=put(s.sets, n, wanted),
                    asked=s.asked | {(s.owner, n, axis)},
                    requester=("idle",),
                )

    def dying(s: Stops) -> Iterator[Stops]:
        if s.requester_kills < kills:
            kills_now = s.requester_kills + 1
            yield s._replace(owner=s.owner + 1, requester=("claim", 0), requester_kills=kills_now)
        if s.kernel_kills < kills:
            yield s._replace(kernel=("begin", 0), kernel_kills=s.kernel_kills + 1)

    def without(s: Stops, n: int) -> frozenset[tuple[int, int, int]]:
        return frozenset(one for one in s.asked if one[1] != n)

    def judged(pid: int, n: int, axes: int, asked: frozenset[tuple[int, int, int]]) -> str:
        """What is wrong with a set that was taken, in the name of ``pid``, of those requests."""
        for axis in range(STOP_AXES):
            by = {one[0] for one in asked if one[1:] == (n, axis)}
            if by and not axes >> axis & 1:
                return "lost"
            if axes >> axis & 1 and not by:
                return "doubled"
            if axes >> axis & 1 and pid not in by:
                return "told of another process"
        return ""

    def kernel(s: Stops) -> Iterator[Stops]:
        match s.kernel:
            case ("idle",):
                yield s._replace(kernel=("look", s.sets[0]))
            case ("look", first):
                seen = (first, s.sets[1])
                if any(seen):
                    yield s._replace(kernel=("name", seen))
                else:
                    yield s._replace(kernel=("idle",))
            case ("name", seen):
                yield s._replace(kernel=("take", s.pid, seen, STOP_SETS - 1))
            case ("take", pid, seen, -1):
                yield s._replace(kernel=("idle",))
            case ("take", pid, seen, n):
                if only_seen and not seen[n]:
                    yield s._replace(kernel=("take", pid, seen, n - 1))
                elif exchanged:
                    gone = s._replace(sets=put(s.sets, n, 0), asked=without(s, n))
                    yield gone._replace(kernel=("tell", pid, seen, n, s.sets[n], s.asked))
                else:
                    yield s._replace(kernel=("zero", pid, seen, n, s.sets[n]))
            case ("zero", pid, seen, n, axes):
                gone = s._replace(sets=put(s.sets, n, 0), asked=without(s, n))
                yield gone._replace(kernel=("tell", pid, seen, n, axes, s.asked))
            case ("tell", pid, seen, n, axes, asked):
                bad = judged(pid if named_first else s.pid, n, axes, asked)
                yield s._replace(kernel=("take", pid, seen, n - 1), bad=bad)
            case ("begin", n):
                following = ("begin", n + 1) if n + 1 < STOP_SETS else ("idle",)
                yield s._replace(sets=put(s.sets, n, 0), asked=without(s, n), kernel=following)

    return lambda s: (*requester(s), *kernel(s), *dying(s)) if not s.bad else ()


def stop_wrong(s: Stops) -> str | None:
    """Lost, doubled, told of another process; or a request that no kernel will find."""
    if any(not s.sets[n] >> axis & 1 for _, n, axis in s.asked):
        return "lost"
    return s.bad or None
