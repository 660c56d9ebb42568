"""The node: results as topics, and the actions to teach and to run. The rules are in the other modules."""

from __future__ import annotations

import threading
from typing import Any

import rclpy
from caesura_interfaces import action, msg
from rclpy.action import ActionServer, CancelResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from caesura_clients import CaesuraError, Update, connect
from caesura_protocol.messages import Changepoints, Description, Segments
from caesura_protocol.programs.document import document
from caesura_ros.conversion import as_ros
from caesura_ros.running import run
from caesura_ros.teaching import teach

LATEST = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)  # for who comes later
TOPICS = {"changepoints": msg.Changepoints, "segments": msg.Segments, "program": msg.Program}


def made(name: str, values: dict[str, Any]) -> Any:
    """A message of ROS 2 from its name and its fields."""
    return getattr(msg, name)(**values)


class CaesuraNode(Node):
    """Publishes what the service finds; parameters: endpoint, station."""

    def __init__(self) -> None:
        super().__init__("caesura")
        endpoint = self.declare_parameter("endpoint", "tcp/127.0.0.1:7447").value
        self.station = self.declare_parameter("station", "*").value
        self.caesura = connect(endpoint)
        self.topics = {
            name: self.create_publisher(kind, f"~/{name}", LATEST) for name, kind in TOPICS.items()
        }
        group = ReentrantCallbackGroup()
        self.servers = [
            ActionServer(self, kind, f"~/{name}", execute, cancel_callback=_accept, callback_group=group)
            for name, kind, execute in (("teach", action.Teach, self.teach), ("run", action.Run, self.run))
        ]
        threading.Thread(target=self.follow, name="results", daemon=True).start()

    def follow(self) -> None:
        """Publish each change of each session of the station."""
        for update in self.caesura.results(self.station):
            for name, message in (
                ("changepoints", changepoints_of(update)),
                ("segments", segments_of(update)),
                ("program", update.program),
            ):
                self.topics[name].publish(as_ros(message, made))

    def teach(self, goal: Any) -> Any:
        """Carry the action `Teach` out."""
        asked, feedback, result = goal.request, action.Teach.Feedback(), action.Teach.Result()

        def report(update: Update) -> None:
            feedback.session, feedback.segments = update.session, as_ros(segments_of(update), made)
            goal.publish_feedback(feedback)

        description = Description(task=asked.task or None, operator=asked.operator or None)
        done = teach(
            self.caesura,
            asked.station,
            asked.session,
            description,
            report,
            lambda: goal.is_cancel_requested,
        )
        result.success, result.message, result.session = done.success, done.message, done.session
        if done.program is not None:
            result.program = as_ros(done.program, made)
        return _ended(goal, result)

    def run(self, goal: Any) -> Any:
        """Carry the action `Run` out."""
        asked, feedback, result = goal.request, action.Run.Feedback(), action.Run.Result()

        def report(line: str) -> None:
            feedback.line = line
            goal.publish_feedback(feedback)

        try:
            found = self.caesura.snapshot(asked.station, asked.session or None).program
        except CaesuraError as error:
            result.message = str(error)
            return _ended(goal, result)
        result.success, result.message = run(
            document(found),
            asked.format,
            asked.host,
            report,
            lambda: goal.is_cancel_requested,
            gripper=asked.gripper,
            unchecked=asked.unchecked,
        )
        return _ended(goal, result)

    def destroy_node(self) -> None:
        """Leave both networks."""
        self.caesura.close()
        super().destroy_node()


def changepoints_of(update: Update) -> Changepoints:
    """All changepoints of a session, as the wire has them."""
    return Changepoints(**_result_fields(update), first=0, changepoints=update.changepoints)


def segments_of(update: Update) -> Segments:
    """All segments and phases of a session, as the wire has them."""
    return Segments(**_result_fields(update), first=0, segments=update.segments, phases=update.phases)


def _result_fields(update: Update) -> dict[str, Any]:
    status = update.status
    return {name: getattr(status, name) for name in ("station", "session", "instance", "epoch", "seq", "t")}


def _accept(goal: Any) -> CancelResponse:
    return CancelResponse.ACCEPT


def _ended(goal: Any, result: Any) -> Any:
    """A goal in its final state, and its result."""
    if goal.is_cancel_requested:
        goal.canceled()
    elif result.success:
        goal.succeed()
    else:
        goal.abort()
    return result


def main() -> None:
    """Run the node until it is interrupted."""
    rclpy.init()
    node = CaesuraNode()
    try:
        rclpy.spin(node, MultiThreadedExecutor())
    except KeyboardInterrupt:
        pass
    finally:
        node.destroy_node()
        rclpy.try_shutdown()
