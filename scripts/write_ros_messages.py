"""Write deploy/ros2/caesura_interfaces/msg: the published messages as definitions of ROS 2.

python scripts/write_ros_messages.py           # writes
python scripts/write_ros_messages.py --check   # exits 1 where a definition differs from the wire's model
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

TOP = Path(__file__).resolve().parents[1]
FOLDER = TOP / "deploy" / "ros2" / "caesura_interfaces" / "msg"
sys.path.insert(0, str(TOP / "deploy" / "ros2" / "caesura_ros"))

from caesura_ros.conversion import PUBLISHED, fields_of, nested_models  # noqa: E402 - by the path above


def main() -> int:
    """Write or check; returns the exit code."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true")
    check = parser.parse_args().check
    wanted = definitions()
    there = {path.name: path.read_text("utf-8") for path in FOLDER.glob("*.msg")}
    if check:
        wrong = sorted(name for name in wanted | there if wanted.get(name) != there.get(name))
        print("\n".join(f"{name} differs; run scripts/write_ros_messages.py" for name in wrong) or "in step")
        return int(bool(wrong))
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name in there.keys() - wanted.keys():
        (FOLDER / name).unlink()
    for name, text in wanted.items():
        (FOLDER / name).write_text(text, "utf-8")
    return 0


def definitions() -> dict[str, str]:
    """The text of every definition, by the name of its file."""
    models = [one for published in PUBLISHED for one in nested_models(published)]
    texts = {}
    for model in models:
        about = (model.__doc__ or "").strip().splitlines()[0]
        lines = [
            f"# {about}",
            "# An absent number is NaN, an absent text empty, everything else an empty array.",
        ]
        lines += [f"{field.type} {field.name}" for field in fields_of(model)]
        texts[f"{model.__name__}.msg"] = "\n".join(lines) + "\n"
    return texts


if __name__ == "__main__":
    sys.exit(main())
