"""Which peers are installed."""

import importlib.util

import pytest


@pytest.fixture(params=["rclpy", "pyzeros", "zenoh_ros2_sdk"])
def node(request: pytest.FixtureRequest) -> str:
    if importlib.util.find_spec(request.param) is None:
        pytest.skip(f"needs {request.param}: pip install -e '.[peers]'")
    return str(request.param)
