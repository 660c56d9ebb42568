"""The node: results as topics, and the actions to teach and to run. The rules are in the other modules."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import Any

import rclpy
from caesura_interfaces import action, msg
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, QoSProfile

from caesura_clients import CaesuraError, Update, connect
from caesura_clients.demonstration_control import changed
from caesura_protocol.messages import Changepoints, Description, Segments
from caesura_protocol.programs.document import document
from caesura_ros.conversion import as_ros
from caesura_ros.running import run
from caesura_ros.teaching import teach

GOALS = 8  # under way at the same time: each one blocks a thread of the executor
SPARE_THREADS = 2  # for new goals and cancellations, while GOALS are under way
ENDS_S = 15.0  # that the goals under way have to end with the node
KEPT = 32  # newest messages of a topic for later subscribers: a station may have several sessions
LATEST = QoSProfile(depth=KEPT, durability=DurabilityPolicy.TRANSIENT_LOCAL)
TOPICS = {"changepoints": msg.Changepoints, "segments": msg.Segments, "program": msg.Program}
Key = Callable[[Any], tuple[str, str]]  # the request of a goal → what it needs for itself


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
        self.under_way: set[tuple[str, str]] = set()
        self.goals = threading.Condition()  # of `under_way`
        group = ReentrantCallbackGroup()
        self.servers = [
            ActionServer(
                self,
                kind,
                f"~/{name}",
                self.blocking(kind, execute, key),
                goal_callback=self.admitting(key),
                handle_accepted_callback=self.starting(key),
                cancel_callback=_accept,
                callback_group=group,
            )
            for name, kind, execute, key in (
                ("teach", action.Teach, self.teach, lambda asked: ("station", asked.station)),
                ("run", action.Run, self.run, lambda asked: ("robot", asked.host)),
            )
        ]
        threading.Thread(target=self.follow, name="results", daemon=True).start()

    def admitting(self, key: Key) -> Callable[[Any], GoalResponse]:
        """Return the callback that rejects a second goal at a station or robot, and more than GOALS."""

        def admit(asked: Any) -> GoalResponse:
            what = key(asked)
            with self.goals:
                if what in self.under_way:
                    reason = f"the {' '.join(what)} has a goal under way"
                elif len(self.under_way) >= GOALS:
                    reason = f"{GOALS} goals are under way, which is the most"
                else:
                    self.under_way.add(what)
                    return GoalResponse.ACCEPT
            self.get_logger().warning(f"goal rejected: {reason}")
            return GoalResponse.REJECT

        return admit

    def starting(self, key: Key) -> Callable[[Any], None]:
        """Return the callback that starts an accepted goal, or makes room for the next if that fails.

        rclpy looks whether a goal is cancelled, and then makes it an executing one. It raises for a goal that
        is cancelled between the two, and starts it at a second try: `carry_out` then ends it as cancelled.
        """

        def start(goal: Any) -> None:
            try:
                try:
                    goal.execute()
                except Exception:
                    if not goal.is_cancel_requested:
                        raise
                    goal.execute()
            except BaseException:
                self.make_room(key(goal.request))
                raise

        return start

    def make_room(self, what: tuple[str, str]) -> None:
        """Let a station or robot have its next goal."""
        with self.goals:
            self.under_way.discard(what)
            self.goals.notify_all()

    def blocking(self, kind: Any, execute: Callable[[Any], Any], key: Key) -> Callable[[Any], Any]:
        """Return the callback that carries a goal out, states why it failed, and makes room for the next."""

        def carry_out(goal: Any) -> Any:
            try:
                return execute(goal)
            except Exception as error:  # rclpy would abort the goal with an empty result
                self.get_logger().error(f"goal failed: {error!r}")
                failed = kind.Result()
                failed.success, failed.message = False, str(error)
                return _ended(goal, failed, is_cancelled=False)
            finally:
                self.make_room(key(goal.request))

        return carry_out

    def follow(self) -> None:
        """Publish each change of each session of the station."""
        try:
            for update in self.caesura.results(self.station):
                for name, message in (
                    ("changepoints", changepoints_of(update)),
                    ("segments", segments_of(update)),
                    ("program", update.program),
                ):
                    self.topics[name].publish(as_ros(message, made))
        except Exception as error:  # goals under way go on: one may move a robot
            self.get_logger().fatal(f"results are no longer published: {error!r}")

    def teach(self, goal: Any) -> Any:
        """Carry the action `Teach` out."""
        asked, feedback, result = goal.request, action.Teach.Feedback(), action.Teach.Result()

        def report(update: Update) -> None:
            feedback.session, feedback.segments = update.session, as_ros(segments_of(update), made)
            goal.publish_feedback(feedback)

        description = changed(Description(), task=asked.task or None, operator=asked.operator or None)
        done = teach(
            self.caesura,
            asked.station,
            asked.session,
            description,
            report,
            lambda: _is_over(goal),
        )
        result.success, result.message, result.session = done.success, done.message, done.session
        if done.program is not None:
            result.program = as_ros(done.program, made)
        return _ended(goal, result, is_cancelled=goal.is_cancel_requested)

    def run(self, goal: Any) -> Any:
        """Carry the action `Run` out."""
        asked, feedback, result = goal.request, action.Run.Feedback(), action.Run.Result()

        def report(line: str) -> None:
            feedback.line = line
            goal.publish_feedback(feedback)

        try:
            found = self.caesura.snapshot(asked.station, asked.session or None)
        except CaesuraError as error:
            result.message = str(error)
            return _ended(goal, result, is_cancelled=goal.is_cancel_requested)
        result.success, result.message = run(
            document(found.program, phases=found.segments.phases),
            asked.format,
            asked.host,
            report,
            lambda: _is_over(goal),
            robot=asked.robot,
            gripper=asked.gripper,
            unchecked=asked.unchecked,
        )
        # What was done before the cancellation came is not cancelled: a controller may run it on.
        return _ended(goal, result, is_cancelled=goal.is_cancel_requested and not result.success)

    def destroy_node(self) -> None:
        """Leave both networks, once the goals under way have ended."""
        with self.goals:
            self.goals.wait_for(lambda: not self.under_way, ENDS_S)
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


def _is_over(goal: Any) -> bool:
    """Is a goal cancelled? The end of the node cancels all: no robot moves on without it."""
    return goal.is_cancel_requested or not rclpy.ok()


def _ended(goal: Any, result: Any, *, is_cancelled: bool) -> Any:
    """A goal in its final state, and its result."""
    if is_cancelled:
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
        rclpy.spin(node, MultiThreadedExecutor(num_threads=GOALS + SPARE_THREADS))
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    finally:
        rclpy.try_shutdown()  # ends the goals under way
        node.destroy_node()
