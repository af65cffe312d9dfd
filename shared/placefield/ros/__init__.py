"""ROS 2 messages, their images, and ROS 2 keys on Zenoh, with no ROS installed."""
