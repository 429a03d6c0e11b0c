"""The hand-written controllers that ours is timed against are the same controllers."""

import pytest

from slipctl.run import build


@pytest.mark.second
@pytest.mark.skipif(build.compiler() is None, reason="no C compiler here")
def test_hand_written_steps_are_the_same_law() -> None:
    from bench.peers.steps import bench

    found = bench(1)
    # the recursive covariance amplifies roundings: the hand-written one adds in another order
    assert found["sta_rls_vs_c"]["largest_difference"] < 1e-4
    assert found["eppfc_vs_c"]["largest_difference"] < 1e-11
