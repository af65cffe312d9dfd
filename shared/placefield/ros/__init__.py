"""ROS 2 without ROS: its messages, their images, and its keys on Zenoh."""
