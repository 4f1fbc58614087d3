"""The names of the encodings that the robot's programs use."""

from typing import Optional

from ._native import content_tag

_NAMES = (
    "conduit/frame",
    "sensor_msgs/msg/Imu",
    "sensor_msgs/msg/JointState",
    "sensor_msgs/msg/Range",
    "sensor_msgs/msg/LaserScan",
    "sensor_msgs/msg/BatteryState",
    "apriltag_msgs/msg/AprilTagDetectionArray",
)

_BY_TAG = {content_tag(name): name for name in _NAMES}


def name_of(tag: int) -> Optional[str]:
    """Return the name of an encoding, or ``None`` for an unknown tag."""
    return _BY_TAG.get(tag)
