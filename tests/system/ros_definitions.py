"""The ROS 2 messages that the tests exchange, as ``ros2 interface show`` defines them."""

_TIME = {"builtin_interfaces/msg/Time": "int32 sec\nuint32 nanosec"}
_HEADER = _TIME | {"std_msgs/msg/Header": "builtin_interfaces/Time stamp\nstring frame_id"}
_POSE = {
    "geometry_msgs/msg/Point": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Quaternion": "float64 x 0\nfloat64 y 0\nfloat64 z 0\nfloat64 w 1",
    "geometry_msgs/msg/Pose": "Point position\nQuaternion orientation",
    "geometry_msgs/msg/PoseWithCovariance": "Pose pose\nfloat64[36] covariance",
}
_TWIST = {
    "geometry_msgs/msg/Vector3": "float64 x\nfloat64 y\nfloat64 z",
    "geometry_msgs/msg/Twist": "Vector3 linear\nVector3 angular",
    "geometry_msgs/msg/TwistWithCovariance": "Twist twist\nfloat64[36] covariance",
}
_STATUS = {
    "diagnostic_msgs/msg/KeyValue": "string key\nstring value",
    "diagnostic_msgs/msg/DiagnosticStatus": (
        "byte OK=0\nbyte WARN=1\nbyte ERROR=2\nbyte STALE=3\n"
        "byte level\nstring name\nstring message\nstring hardware_id\nKeyValue[] values"
    ),
}

COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
IMAGE = "sensor_msgs/msg/Image"
ODOMETRY = "nav_msgs/msg/Odometry"
POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
DIAGNOSTICS = "diagnostic_msgs/msg/DiagnosticArray"

PARTS = {
    COMPRESSED_IMAGE: _HEADER,
    IMAGE: _HEADER,
    ODOMETRY: _HEADER | _POSE | _TWIST,
    POSE: _HEADER | _POSE,
    DIAGNOSTICS: _HEADER | _STATUS,
}
"""What each kind of message is made of."""

DEFINITIONS = {
    COMPRESSED_IMAGE: "std_msgs/Header header\nstring format\nuint8[] data",
    IMAGE: (
        "std_msgs/Header header\nuint32 height\nuint32 width\nstring encoding\n"
        "uint8 is_bigendian\nuint32 step\nuint8[] data"
    ),
    ODOMETRY: (
        "std_msgs/Header header\nstring child_frame_id\n"
        "geometry_msgs/PoseWithCovariance pose\ngeometry_msgs/TwistWithCovariance twist"
    ),
    POSE: "std_msgs/Header header\nPoseWithCovariance pose",
    DIAGNOSTICS: "std_msgs/Header header\nDiagnosticStatus[] status",
}
