"""The virtual device as a ROS 2 node; the only folder, besides the examples, that knows ROS."""
