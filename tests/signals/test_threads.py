"""BLAS of one thread, for as long as anybody computes."""

from threadpoolctl import threadpool_info, threadpool_limits

from tactuator.processors import single_threaded


def threads() -> set[int]:
    return {pool["num_threads"] for pool in threadpool_info() if pool["user_api"] == "blas"}


def test_single_threaded__first_ends_while_second_works__stays_until_the_second_ends() -> None:
    with threadpool_limits(limits=2):
        first, second = single_threaded(), single_threaded()
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert threads() == {1}
        second.__exit__(None, None, None)
        assert threads() == {2}
