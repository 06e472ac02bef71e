"""Second way to a robot, for the watchdog's process: where the transport lets a second process of ours write."""

from __future__ import annotations

from stiction.deploy.transports.config import HeldCfg
from stiction.deploy.transports.link import Link, Spare
from stiction.files.contract import Contract


def open_spare(spare: Spare, contract: Contract) -> Link:
    """Return a link to the robot that another process of ours drives; nothing is sent. Errors as of the transport's."""
    if spare.transport == "udp":
        from stiction.deploy.transports.udp import LOOPBACK, UdpLink

        return UdpLink((LOOPBACK, 0), **spare.settings, file=spare.files[0])
    from stiction.deploy.transports.unitree import unitree_link

    held = HeldCfg(**spare.settings["held"])
    return unitree_link(spare.transport, spare.settings["interface"], spare.settings["domain"], contract, held)
