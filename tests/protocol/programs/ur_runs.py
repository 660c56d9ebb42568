"""Runs of URScript on the fake controller."""

from __future__ import annotations

from typing import Any

from caesura_protocol.messages import App
from caesura_protocol.programs.document import ProgramFile
from caesura_protocol.programs.ur_script import ur_script
from harness.programs import as_file

from .fake_ur_controller import Controller

MOVES = ("movej", "movel", "movep")


def on_ur(apps: tuple[App, ...], **changed: Any) -> ProgramFile:
    return as_file(apps).model_copy(update={"robot": "ur5e", "gripper": "robotiq_2f_85"} | changed)


def played(program: ProgramFile, **world: Any) -> Controller:
    controller = Controller(**world)
    controller.play(ur_script(program))
    return controller


def places(controller: Controller) -> list[list[float]]:
    return [move.get("pose") or move["q"] for move in controller.named(*MOVES)]
