"""What is between drivers and instruments, as another process gets it."""

import pickle

from labctl.bench.recording.wire import Wire


def test_whether_a_replay_differed_is_no_business_of_other_processes() -> None:
    wire = Wire(replay={"bench": {"laser": "TCPIP0::127.0.0.1::5025::SOCKET"}}, differed=lambda: True)
    elsewhere = pickle.loads(pickle.dumps(wire))  # noqa: S301 -- our own
    assert (elsewhere.replay, elsewhere.differed()) == (wire.replay, False)
