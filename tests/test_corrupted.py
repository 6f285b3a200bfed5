"""The short form of `benchmarks/corrupted.py`: what is taken for a position on a line that corrupts bytes."""

import pytest
from corrupted import LETS_THROUGH, driven


@pytest.mark.parametrize("protocol", LETS_THROUGH)
@pytest.mark.parametrize("corrupt", [0.1, 0.01])
def test_no_servo_is_taken_to_be_where_it_cannot_have_got(corrupt, protocol):
    row = driven(protocol, 60, corrupt)
    assert row.damaged > 20
    assert row.passed <= row.may_pass
    assert row.too_fast == 0
    assert corrupt == 0.1 or row.taken > 20
