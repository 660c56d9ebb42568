"""Write the golden wire vectors: an example of every message, its bytes, and the encoding that names it.

    python scripts/write_vectors.py           # writes tests/vectors
    python scripts/write_vectors.py --check   # exits 1 where the files differ from what the codec writes

The bytes are a promise to bridges in other languages: they change only with a new major version.
"""

from __future__ import annotations

import argparse
import base64
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np

from caesura_protocol.codec import encode, pack_samples
from caesura_protocol.messages import (
    Ack,
    App,
    AppChange,
    AppOutline,
    AppPath,
    AppReference,
    BridgeAck,
    BridgeControl,
    BridgeStatus,
    Budget,
    ChangeApp,
    Changepoint,
    Changepoints,
    Close,
    Control,
    Correction,
    DamagedSession,
    DeleteApp,
    Describe,
    Description,
    DescriptionAuthor,
    DuplicateApp,
    Edit,
    EditEffect,
    EditProgram,
    Error,
    Gap,
    Heartbeat,
    Hint,
    Hints,
    Insert,
    InsertApp,
    JournalReport,
    LimitForce,
    Message,
    Move,
    MoveApp,
    NamePhase,
    NameProgram,
    Open,
    Phase,
    PhaseOutline,
    Piece,
    Posterior,
    Preview,
    Program,
    ProgramEdit,
    RecordedSamples,
    Redo,
    Refusal,
    Relabel,
    Remove,
    ReplacePart,
    RestForce,
    ScrewMotion,
    Segment,
    SegmentOutline,
    Segments,
    ServiceStatus,
    SessionStatus,
    Since,
    Snapshot,
    Start,
    StationBudgets,
    Stop,
    TakeBack,
    Undo,
    ViaPoint,
    WrenchReport,
)
from caesura_protocol.minmax_decimation import packed

VECTORS = Path(__file__).resolve().parents[1] / "tests" / "vectors"
SESSION = "s20260314-092653-58af"
BRIDGE = "robot-1-4711-58af"
COLUMNS = ("t", "px", "py", "pz", "fx", "fy", "fz")
OF_RESULT: dict[str, Any] = {
    "station": "cell-1",
    "session": SESSION,
    "instance": "caesura-0",
    "epoch": 2,
    "t": 12.5,
}


def samples(dtype: type[np.floating]) -> np.ndarray:
    """Three samples of COLUMNS, every value a power of two or a sum of few: exact in both sizes."""
    matrix = np.array(
        [
            [12.5, 0.5, -0.25, 0.125, 0.0, 0.0, -9.5],
            [12.5009765625, 0.50390625, -0.25, 0.125, 0.25, 0.0, -9.25],
            [12.501953125, 0.5078125, -0.25, 0.125, 0.5, 0.0, -9.0],
        ]
    )
    return matrix.astype(dtype)


def examples() -> dict[str, Message]:
    """One message of every type, two of SampleBatch; the keys are the names of the files."""
    changepoint = Changepoint(t=3.5, probability=0.96875, certainty="provisional")
    segment = Segment(
        t0=0.0,
        tn=3.5,
        kind="transport",
        motion="motion",
        contact="transport",
        probability=0.875,
        runner_up="motion",
        log_odds=2.25,
        certainty="final",
        position_start=(0.5, -0.25, 0.125),
        position_end=(0.625, -0.25, 0.375),
        force_start=(0.0, 0.0, 0.0),
        force_end=(0.0, 0.25, -5.0),
        force_held=None,
        load_kg=0.5,
        load_sd_kg=0.0625,
    )
    phase = Phase(
        t0=0.0,
        tn=3.5,
        kind="contact",
        probability=0.875,
        certainty="provisional",
        first_segment=2,
        last_segment=6,
        strokes=3,
    )
    wrench = WrenchReport(
        source="flange_sensor",
        stated=True,
        hand_on_robot="yes",
        contact_models=True,
        transport_models=True,
        tare=(0.5, -1.25, 2.0),
        note="",
    )
    gap = Gap(t0=5.0, tn=5.25, reason="evicted")
    refusal = Refusal(code="malformed", message="not a map")
    journal = JournalReport(
        kind="sqlite",
        commit_s=0.0625,
        size=1048576,
        size_limit=10_000_000_000,
        waiting=4096,
        disk_free=5_000_000_000,
    )
    budgets = StationBudgets(
        station="cell-1",
        work=Budget(per_s=0.5, at_once=60.0, used=1.25, refused=0),
        messages=Budget(per_s=5000.0, at_once=10000.0, used=10.0, refused=0),
        bytes=Budget(per_s=16e6, at_once=32e6, used=20480.0, refused=0),
        commands=Budget(per_s=500.0, at_once=1000.0, used=1000.0, refused=17),
    )
    description = Description(
        task="pick and place", operator="Ann", note="second gripper", tags=("left", "new"), success=True
    )
    status = SessionStatus(
        **OF_RESULT,
        seq=41,
        state="open",
        preset="people",
        wrench=wrench,
        delay_s=0.0625,
        batches=625,
        samples=12500,
        observations=125,
        duplicates=1,
        repeats=0,
        waiting_for=None,
        gaps=(gap,),
        refused={"malformed": 1},
        last_refusal=refusal,
        hypotheses=37,
        capped=0,
        budgets=budgets,
        description=description,
        described_by=(DescriptionAuthor(field="task", author="Ann"),),
        opened=1767225600.25,
    )
    via = ViaPoint(
        t=1.75,
        position=(0.5625, -0.125, 0.25),
        orientation=(1.0, 0.0, 0.0, 0.0),
        velocity=(0.0625, 0.0, 0.125),
        angular_velocity=(0.0, 0.25, -0.5),
    )
    path = AppPath(
        start=ViaPoint(t=0.0, position=(0.5, -0.25, 0.125), orientation=(1.0, 0.0, 0.0, 0.0)),
        via=(via,),
        tn=3.5,
        length_m=0.375,
        deviation_m=0.0009765625,
        deviation_rad=0.0078125,
        tolerance_m=0.001953125,
        tolerance_rad=0.015625,
    )
    screw = ScrewMotion(
        axis=(0.0, 0.0, -1.0),
        point=(0.5, -0.25, 0.125),
        angle=2.0,
        pitch_m=0.001953125,
        pitch_sd_m=0.0000152587890625,
        torque=(0.0, 0.125, -0.75),
    )
    rest = RestForce(newton=20.0, newton_taught=25.5)
    reference = AppReference(kind="transport", t0=0.0, tn=3.5)
    program_actions = (
        ChangeApp(app=reference, name="carry", speed=0.5, as_taught=("note",)),
        MoveApp(app=reference, after=None),
        DeleteApp(app=reference),
        DuplicateApp(app=reference),
        InsertApp(after=reference, kind="gripper_move", gripper_width=0.03125),
        ReplacePart(first=reference, last=reference, session=f"{SESSION}-again"),
        NameProgram(name="pick and place"),
    )
    edit_program = EditProgram(session=SESSION, revision=1, author="Ann", action=program_actions[0])
    change = AppChange(field="speed", author="Ann", edit=2)
    app = App(
        kind="transport",
        t0=0.0,
        tn=3.5,
        target=(0.625, -0.25, 0.375),
        orientation=(1.0, 0.0, 0.0, 0.0),
        joints=None,
        force=None,
        force_taught=None,
        load_kg=0.5,
        load_sd_kg=0.0625,
        gripper_width=None,
        confidence=0.875,
        segments=(0,),
        path=path,
        screw=screw,
        rest_before=rest,
        name="carry",
        speed=0.5,
        changes=(AppChange(field="name", author="Ann", edit=2), change),
    )
    changepoints = Changepoints(**OF_RESULT, seq=7, first=2, changepoints=(changepoint,))
    segments = Segments(**OF_RESULT, seq=7, first=2, segments=(segment,), first_phase=1, phases=(phase,))
    posterior = Posterior(**OF_RESULT, seq=125, starts=(3.5, 12.0), probabilities=(0.75, 0.25))
    hint = Hint(
        kind="hand_in_wrench",
        since=11.5,
        text="The sensor measures the hand: 8 N along the movement.",
        advice="Hold the arm itself, not the tool.",
    )
    program_edit = ProgramEdit(
        number=2, author="Ann", at=1767225600.25, action=program_actions[0], state="applied"
    )
    part_edit = ProgramEdit(
        number=3,
        author="Ann",
        at=1767225601.25,
        action=program_actions[5],
        state="not_applied",
        reason="the app 'carry' at 0.00 to 3.50 s is no longer in the program",
        apps=(app,),
    )
    corrections = (
        Correction(number=1, author="Ann", at=1767225602.25, action=Move(t=3.5, to=4.0)),
        Correction(
            number=2, author="Bo", at=1767225603.25, action=Relabel(t=1.25, kind="steady"), state="undone"
        ),
    )
    again = Hint(
        kind="show_again",
        since=5.25,
        until=12.5,
        text="Nothing was recorded from 5.0 to 5.2 s.",
        advice="Teach the part from 5.0 to 5.2 s again.",
        t0=5.0,
        tn=5.25,
    )
    hints = Hints(**OF_RESULT, seq=2, hints=(again, hint))
    program = Program(
        **OF_RESULT,
        version=3,
        complete=False,
        apps=(app,),
        notes=("loads below 0.1 kg are not weighed",),
        gaps=(gap,),
        wrench=wrench,
        force_limit_n=10.0,
        edit_revision=3,
        edits=(program_edit, part_edit),
        revision=2,
        corrections=corrections,
    )
    opening = Open(
        session=SESSION,
        columns=COLUMNS,
        wrench_source="flange_sensor",
        hand_on_robot="yes",
        bridge=BRIDGE,
        up=(0.0, 0.0, -1.0),
        description=Description(task="pick and place", operator="Ann"),
    )
    closing = Close(session=SESSION, last_seq=624, bridge=BRIDGE, success=True)
    actions = (
        Insert(t=3.5),
        Remove(t=3.5),
        Move(t=3.5, to=4.0),
        Relabel(t=1.25, kind="steady"),
        LimitForce(t=1.25, newton=12.5),
        NamePhase(t=1.25, name="wipe"),
        Undo(),
        Redo(),
        TakeBack(number=2),
    )
    edit = Edit(session=SESSION, revision=2, author="Ann", action=actions[2])
    preview = Preview(session=SESSION, revision=2, action=actions[1])
    effect = EditEffect(
        first_segment=1,
        segments_before=(
            SegmentOutline(t0=1.25, tn=3.5, kind="motion"),
            SegmentOutline(t0=3.5, tn=5.0, kind="contact"),
        ),
        segments_after=(SegmentOutline(t0=1.25, tn=5.0, kind="contact"),),
        first_app=2,
        apps_after=(
            AppOutline(
                kind="apply_force",
                name="press",
                t0=1.25,
                tn=5.0,
                target=(0.5, 0.25, 0.125),
                force=(0.0, 0.0, -9.5),
            ),
        ),
        first_phase=1,
        phases_after=(PhaseOutline(t0=1.25, tn=5.0, kind="contact", name="wipe"),),
    )
    describe = Describe(session=SESSION, author="Ann", before=Description(), description=description)
    start = Start(id="press-58af", session=SESSION, description=description)
    batch = {"columns": COLUMNS, "session": SESSION, "epoch": 0, "seq": 17, "bridge": BRIDGE}
    messages: list[Message] = [
        Heartbeat(session=SESSION, epoch=0, seq=17, bridge=BRIDGE),
        opening,
        closing,
        edit,
        description,
        *status.described_by,
        describe,
        start,
        Stop(session=SESSION, success=True),
        BridgeControl(command=start),
        BridgeAck(session=SESSION, state="teaching"),
        BridgeStatus(
            station="cell-1",
            bridge=BRIDGE,
            state="teaching",
            source="franky",
            session=SESSION,
            description=description,
            last_session="s20260314-092500-11ab",
            outcome="closed with 625 batches",
        ),
        *actions,
        Since(number=1),
        reference,
        *program_actions,
        edit_program,
        program_edit,
        corrections[0],
        change,
        Control(command=opening),
        Ack(session=SESSION, next_seq=18, state="open", up=(0.0, 0.0, -1.0)),
        preview,
        effect.segments_before[0],
        effect.apps_after[0],
        effect.phases_after[0],
        effect,
        changepoint,
        segment,
        phase,
        gap,
        changepoints,
        segments,
        posterior,
        hint,
        hints,
        wrench,
        refusal,
        budgets.work,
        budgets,
        status,
        via,
        path,
        app,
        screw,
        rest,
        program,
        Snapshot(
            status=status,
            changepoints=changepoints,
            segments=segments,
            posterior=posterior,
            program=program,
            hints=hints,
        ),
        journal,
        DamagedSession(
            station="cell-1", session="s1", why="record 5 is damaged", opened=1767225600.25, set_aside=True
        ),
        ServiceStatus(
            instance="caesura-0",
            epoch=2,
            version="0.1.0",
            sessions_open=1,
            sessions_closed=4,
            messages=2503,
            refused={"malformed": 1},
            last_refusal=refusal,
            queue=0,
            queue_capacity=4096,
            dropped=0,
            journal=journal,
            time=1767225600.25,
            budgets=(budgets,),
            queries=budgets.queries,
        ),
        RecordedSamples(
            station="cell-1",
            session=SESSION,
            instance="caesura-0",
            epoch=2,
            t0=12.0,
            tn=13.0,
            bin_s=0.5,
            available=("px", "fz", "qx", "qy", "qz", "qw", "rotation_x", "rotation_y", "rotation_z"),
            columns=("px", "fz"),
            **packed([np.array([[12.5, 0.5], [12.501953125, 0.5078125]]), np.array([[12.5, -9.5]])]),
            first=0.0,
            last=12.501953125,
            holes=(gap,),
            first_orientation=(1.0, 0.0, 0.0, 0.0),
        ),
        Piece(encoding="application/msgpack;caesura.Ack.v1", whole=7, number=1, count=2, payload=b"\x01\x02"),
        Error(code="evicted", message="the ring no longer has these samples", value=3, limit=17),
    ]
    return {
        "SampleBatch.float32": pack_samples(samples(np.float32), **batch),
        "SampleBatch.float64": pack_samples(samples(np.float64), **batch),
        "Control.Close": Control(command=closing),
        "Control.Edit": Control(command=edit),
        "Control.Preview": Control(command=preview),
        "Ack.effect": Ack(session=SESSION, next_seq=18, state="open", revision=3, effect=effect),
        "Ack.correction": Ack(
            session=SESSION, next_seq=18, state="open", revision=4, effect=effect, correction=corrections[0]
        ),
        "Ack.program_edit": Ack(session=SESSION, next_seq=18, state="open", program_edit=program_edit),
        "Control.Describe": Control(command=describe),
        "Control.EditProgram": Control(command=edit_program),
        "BridgeControl.Stop": BridgeControl(command=Stop(session=SESSION, success=True)),
        **{type(message).__name__: message for message in messages},
    }


def files() -> dict[str, bytes]:
    """Name and content of every vector file."""
    content: dict[str, bytes] = {}
    for name, message in examples().items():
        payload, encoding = encode(message)
        described = {
            "type": type(message).__name__,
            "encoding": encoding,
            "fields": _plain(message.model_dump()),
        }
        content[f"{name}.json"] = (json.dumps(described, indent=2) + "\n").encode()
        content[f"{name}.msgpack"] = payload
    return content


def _plain(value: Any) -> Any:
    """The fields as JSON; bytes as base64."""
    if isinstance(value, bytes):
        return {"base64": base64.b64encode(value).decode()}
    if isinstance(value, dict):
        return {key: _plain(item) for key, item in value.items()}
    return [_plain(item) for item in value] if isinstance(value, list | tuple) else value


def main() -> int:
    """Write or check; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true")
    wanted = files()
    known = {
        path.name: path.read_bytes() for path in VECTORS.glob("*") if path.suffix in {".json", ".msgpack"}
    }
    if parser.parse_args().check:
        drifted = sorted(name for name in wanted | known if wanted.get(name) != known.get(name))
        print(
            f"drifted: {', '.join(drifted)}; a change of bytes needs a new major version"
            if drifted
            else "in step"
        )
        return int(bool(drifted))
    for stale in known.keys() - wanted.keys():
        (VECTORS / stale).unlink()
    for name, content in wanted.items():
        (VECTORS / name).write_bytes(content)
    return 0


if __name__ == "__main__":
    sys.exit(main())
