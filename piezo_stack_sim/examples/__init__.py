"""Controllers to start from, each a ROS process of its own beside the device."""
