"""The node, with the service's endpoint and the station as arguments."""

from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node
from launch_ros.parameter_descriptions import ParameterValue

ARGUMENTS = {"endpoint": "tcp/127.0.0.1:7447", "station": "*"}


def generate_launch_description():
    """What `ros2 launch caesura_ros caesura.launch.py station:=cell-1` starts."""
    return LaunchDescription(
        [
            *(DeclareLaunchArgument(name, default_value=value) for name, value in ARGUMENTS.items()),
            Node(
                package="caesura_ros",
                executable="caesura_node",
                name="caesura",
                output="screen",
                # Texts: launch_ros reads any other value as YAML, in which `*` is an error and 7 a number.
                parameters=[
                    {name: ParameterValue(LaunchConfiguration(name), value_type=str) for name in ARGUMENTS}
                ],
            ),
        ]
    )
