"""The dual-port RAM below ``sjerk.handshake``: files and locks, layout, inventory."""

from sjerk.dpram.files import TRACE, Lock
from sjerk.dpram.inventory import SegmentInfo, clean
from sjerk.dpram.layout import Layout, raise_for_status

__all__ = ["TRACE", "Layout", "Lock", "SegmentInfo", "clean", "raise_for_status"]
