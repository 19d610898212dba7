"""CANopen (CiA 301): a simulated drive on a bus, and a kernel as its master (extra ``canopen``)."""

from sjerk.ports.canopen.frames import Frame, Send, sender
from sjerk.ports.canopen.master import MASTER, Master
from sjerk.ports.canopen.node import NmtState, Node
from sjerk.ports.canopen.sdo import SdoClient, SdoServer

__all__ = [
    "MASTER",
    "Frame",
    "Master",
    "NmtState",
    "Node",
    "SdoClient",
    "SdoServer",
    "Send",
    "sender",
]
