"""What `hapscene play` tells of a servo."""

from hapscene.errors import HandleError
from hapscene.play.monitor import Monitor


class MuteServo:
    """A servo whose handle is gone."""

    def __init__(self) -> None:
        self.asked = 0

    def handle_report(self) -> dict[str, float]:
        self.asked += 1
        raise HandleError("dualsense: plays no more: was it unplugged?" if self.asked == 1 else "has ended")


def test_first_error_of_a_disconnected_handle_is_reported() -> None:
    monitor = Monitor.__new__(Monitor)
    monitor._servo, monitor._mute = MuteServo(), ""  # type: ignore[assignment]
    for _ in range(2):
        assert "was it unplugged?" in monitor._handle_problem()
