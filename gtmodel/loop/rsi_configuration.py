"""The configuration that tells an RSI controller whom to talk to and which elements to send and to take."""

from __future__ import annotations

import re

from .exchange import AXES

_ADDRESS = re.compile(r"\d{1,3}(\.\d{1,3}){3}")
# what the controller's own tags are called
_SENT = ("DEF_RIst", "DEF_RSol", "DEF_AIPos", "DEF_ASPos", "DEF_EIPos", "DEF_ESPos", "DEF_Delay")


def rsi_configuration(address: str, port: int) -> str:
    """XML for the KUKA controller: corrections of joints, external axes and pose are taken, all with HOLDON="1".

    address, port: of the computer on which the loop runs. With HOLDON="0" one late answer would send the robot back to
    its start pose at once; with 1 it keeps the last one. Raises ValueError for what is no IPv4 address and port. It was
    tested against no controller.

    >>> text = gt.loop.rsi_configuration("192.168.1.10", 49152)
    >>> "<IP_NUMBER>192.168.1.10</IP_NUMBER>" in text
    True
    """
    if not _ADDRESS.fullmatch(address) or not 0 < port < 65536:
        raise ValueError(f"'{address}', port {port}: expected an IPv4 address and a port from 1 to 65535")
    lines = ["<ROOT>", "  <CONFIG>", f"    <IP_NUMBER>{address}</IP_NUMBER>", f"    <PORT>{port}</PORT>"]
    lines += ["    <SENTYPE>ImFree</SENTYPE>", "    <ONLYSEND>FALSE</ONLYSEND>", "  </CONFIG>", "  <SEND>"]
    lines.append("    <ELEMENTS>")
    lines += [f'      <ELEMENT TAG="{tag}" TYPE="DOUBLE" INDX="INTERNAL"/>' for tag in _SENT]
    lines += ["    </ELEMENTS>", "  </SEND>", "  <RECEIVE>", "    <ELEMENTS>"]
    taken = [f"RKorr.{c}" for c in "XYZABC"]
    taken += [f"AK.A{n}" for n in range(1, AXES + 1)] + [f"EK.E{n}" for n in range(1, AXES + 1)]
    lines += [f'      <ELEMENT TAG="{tag}" TYPE="DOUBLE" INDX="{n}" HOLDON="1"/>' for n, tag in enumerate(taken, 1)]
    lines += ["    </ELEMENTS>", "  </RECEIVE>", "</ROOT>"]
    return "\n".join(lines) + "\n"
