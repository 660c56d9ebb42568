"""The package as ament_python installs it."""

from glob import glob

from setuptools import setup

NAME = "caesura_ros"

setup(
    name=NAME,
    version="0.1.0",
    packages=[NAME],
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{NAME}"]),
        (f"share/{NAME}", ["package.xml"]),
        (f"share/{NAME}/launch", glob("launch/*.launch.py")),
    ],
    install_requires=["setuptools", "caesura-teaching"],
    zip_safe=True,
    description="Caesura's results as topics of ROS 2, and actions to teach and to run",
    license="Apache-2.0",
    entry_points={"console_scripts": [f"caesura_node = {NAME}.node:main"]},
)
