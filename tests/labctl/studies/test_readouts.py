"""What is made of readouts of runs."""

from labctl.studies.readouts import file_name


def test_a_readout_is_called_by_its_ports_at_however_many_wavelengths() -> None:
    usual = "softmax-0.4ns-ports-2-3-4-5-6.h5"
    assert file_name(0.4e-9, None, 1.0, (2, 3, 4, 5, 6)) == usual
    assert file_name(0.4e-9, None, 1.0, (2, 3, 4, 5, 6) * 50) == usual, "no file system takes 500 characters"
    assert file_name(1e-9, 80e-12, 0.1, (2,)) == "softmax-1.0ns-every-80ps-C-0.1-ports-2.h5"
