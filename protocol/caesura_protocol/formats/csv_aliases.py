"""Names of csv columns in other software: English and German ones, and those of UR's RTDE."""

from __future__ import annotations

from collections.abc import Mapping

from caesura_protocol.messages import COLUMNS_OF_SIGNAL

#: Names of each signal's columns, without case, unit and separators. {a}: the axis; {n}: the number from 1
#: on; {i}: that from 0 on, as RTDE counts, whose wrench has its moments from {k} on;
#: {m}: that in libfranka's O_T_EE, a matrix column by column.
_SPELLINGS: Mapping[str, str] = {
    "t": """
        time timestamp seconds elapsed elapsedtime stamp timestep sampletime
        zeit zeitstempel sekunden laufzeit messzeit
    """,
    "pos": """
        {a} pos{a} position{a} {a}pos {a}position tcp{a} tcppos{a} tcpposition{a} ee{a} eepos{a} eeposition{a}
        flange{a} tool{a} coordinate{a} {a}coordinate poseposition{a} positionee{a} actualtcppose{i} otee{m}
        flansch{a} lage{a} tcplage{a} koordinate{a} {a}koordinate tcpkoordinate{a} werkzeug{a}
    """,
    "quat": "quat{a} quaternion{a} orientation{a} poseorientation{a} orientierung{a}",
    "q": """
        joint{n} j{n} a{n} jointposition{n} jointpos{n} jointangle{n} axis{n} actualq{i}
        gelenk{n} gelenkwinkel{n} gelenkposition{n} achse{n} achswinkel{n}
    """,
    "force": """
        f{n} f{a}tool f{a}tcp force{a} {a}force wrenchforce{a} ftforce{a} tcpforce{a} forcetcp{a}
        contactforce{a} actualtcpforce{i} extf{a} extforce{a} externalforce{a}
        kraft{a} {a}kraft tcpkraft{a} krafttcp{a} kontaktkraft{a}
    """,
    "torque": """
        t{a} torque{a} {a}torque moment{a} {a}moment wrenchtorque{a} tq{a} trq{a} tcpmoment{a}
        actualtcpforce{k} extt{a} exttorque{a} externaltorque{a}
        drehmoment{a} {a}drehmoment kraftmoment{a}
    """,
    "tau": """
        jointtorque{n} externaltorque{n} tauext{n} tauj{n}
        gelenkmoment{n} achsmoment{n} externesmoment{n} gelenkdrehmoment{n}
    """,
    "gripper": """
        gripperwidth width gripperopening opening gripperposition fingerwidth jawopening
        greifer greiferoeffnung oeffnung oeffnungsweite greiferweite greiferbreite greiferposition
        fingerabstand
    """,
}


def _names(column: str, index: int, spellings: str) -> frozenset[str]:
    """Return every name of a column, which has this index in its signal."""
    counted = {"a": column[-1], "i": index, "n": index + 1, "k": index + 3, "m": index + 12}
    return frozenset({column, *(spelling.format(**counted) for spelling in spellings.split())})


#: Names without case, unit and separators, by Caesura's column.
ALIASES: Mapping[str, frozenset[str]] = {
    column: _names(column, index, spellings)
    for signal, spellings in _SPELLINGS.items()
    for index, column in enumerate(COLUMNS_OF_SIGNAL.get(signal, (signal,)))
}

#: Names of three angles, likewise. `rx ry rz` alone are turns about three axes as often as a rotation vector:
#: a person must say which.
TURN_ALIASES: Mapping[str, frozenset[str]] = {
    **{
        f"r{axis}": frozenset(name.format(axis) for name in ("rotvec{}", "rotationvector{}", "axisangle{}"))
        | {f"actualtcppose{index}"}
        for index, axis in enumerate("xyz", start=3)
    },
    **{
        turn: frozenset(
            {turn, f"tcp{turn}", f"ee{turn}", f"flange{turn}", f"orientation{turn}", f"pose{turn}"}
        )
        for turn in ("roll", "pitch", "yaw")
    },
}
