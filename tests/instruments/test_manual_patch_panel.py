"""Fibres moved by hand."""

import pytest

from instruments.errors import OutOfRange
from instruments.manual_patch_panel import ManualPatchPanel


def test_fibres_are_moved_only_when_they_must() -> None:
    requests: list[str] = []

    def operator(request: str) -> str:
        requests.append(request)
        return ""

    panel = ManualPatchPanel(operator, ports=(2, 3))
    assert panel.asks({1: 2, 2: 3})
    panel.connect({1: 2, 2: 3})
    assert not panel.asks({1: 2, 2: 3})
    panel.connect({1: 2, 2: 3})
    (request,) = requests
    assert request.startswith("The light is off until you press Enter")
    assert request.endswith("connect port 2 to CH1, port 3 to CH2, and nothing else, then press Enter")
    assert panel.settings() == {"ch1": 2, "ch2": 3}
    with pytest.raises(OutOfRange, match="port 9"):
        panel.connect({1: 9})
    panel.self_test()
    panel.make_safe()
    panel.close()
    assert panel.identify().model
