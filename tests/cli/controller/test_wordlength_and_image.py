"""`tactuator wordlength`, `build` and `image`, as a user runs them."""

from dataclasses import replace

import pytest

from tactuator.io.controller import read_controller, write_controller
from tactuator.model.controller import Limits
from tactuator.wordlength.formats import FORMATS
from tests.runtime.paper_display import changed, channel, controller, display, louder


def test_wordlength__unsafe_format_asked_for__status_1_and_every_format_with_its_figures(desk, run) -> None:
    reported = run.json("wordlength", "controller.json", "--format", "q15 biquads", status=1)
    assert set(reported) == {"rate_hz", "formats", "recommended"}
    assert (reported["rate_hz"], reported["recommended"]) == (4000.0, "float32")
    assert [each["name"] for each in reported["formats"]] == [each.name for each in FORMATS]
    figures = {"response_error_db", "roundoff_db_sl", "limit_cycle_db_sl"}
    for each in reported["formats"]:
        assert set(each) == {"name", "stable", "loads", "safe", "refused"} | figures
        assert all((each[figure] is not None) == each["stable"] for figure in figures)
    assert [each["loads"] for each in reported["formats"] if each["loads"]] == ["float32", "q31"]


def test_wordlength__another_rate_and_figure__drawn_and_told(desk, run) -> None:
    reported = run.json("wordlength", "controller.json", "--rate", "2000", "--figures", "figures")
    assert (reported["rate_hz"], reported["figures"]) == (2000.0, "figures")
    assert sorted(path.name for path in (desk / "figures").iterdir()) == ["resolution.csv", "resolution.svg"]
    assert list(reported["resolution_bits"]["prefilter"]["sections"]) == ["2000", "4000", "8000", "16000"]


def test_wordlength__table__says_what_it_recommends_and_what_q31_cannot_hold(desk, run) -> None:
    of = display(channel())
    wide = replace(
        of, channels=tuple(replace(each, converter=replace(each.converter, range_v=20.0)) for each in of.channels)
    )
    write_controller("controller.json", changed(controller(wide), limits=Limits(20.0, 2.0)))
    shown = " ".join(run("wordlength", "controller.json").out.split())
    assert "recommended: float32" in shown
    assert "q31: channel 'index': command_v is 20; allowed: at most 15 V in Q31." in shown


def test_loop_that_does_not_close__no_format_is_recommended_and_no_image_built(desk, run) -> None:
    write_controller("controller.json", louder(read_controller("controller.json"), 60.0))
    ended = run("wordlength", "controller.json")
    assert ended.status == 1
    assert "recommended: none of what a board runs" in " ".join(ended.out.split())
    (desk / "image.bin").write_bytes(b"old")
    words = "format float32 is not safe for this controller (unstable); allowed: what `wordlength` calls safe"
    run.refused("build", "controller.json", "--out", "image.bin", said=words)
    assert (desk / "image.bin").read_bytes() == b"old"


@pytest.mark.parametrize("number_format", ["float32", "q31"])
def test_build__twice_then_image__same_bytes_and_say_the_same_of_them(number_format, desk, run) -> None:
    image = desk / "image.bin"
    words = ("build", "controller.json", "--format", number_format, "--out", image)
    assert run(*words).status == 0
    before, built = image.read_bytes(), run.json(*words)
    assert image.read_bytes() == before
    assert (built["image"], built["bytes"]) == (str(image), len(before))
    assert (built["format"], built["rate_hz"], built["channels"]) == (number_format, 4000.0, 1)
    assert built["controller"] == read_controller("controller.json").content_hash
    assert 0.0 <= built.pop("response_error_db") < 1e-3
    read = run.json("image", image, "--controller", "controller.json")
    assert (read.pop("is_of_controller"), read["delay_samples"]) == (True, 1)
    assert read == built
    assert built["crc32"] in run("image", image).out
    spoilt = changed(read_controller("controller.json"), limits=Limits(9.0, 2.0))
    write_controller("controller.json", spoilt)
    assert run.json("image", image, "--controller", "controller.json", status=1)["is_of_controller"] is False


def test_image__spoilt_or_for_another_display__is_refused(desk, run) -> None:
    """The core's refusals by name: tests/runtime/test_image."""
    image = desk / "image.bin"
    assert run("build", "controller.json", "--out", image).status == 0
    content = image.read_bytes()
    for name, changes, words in (
        ("rate", {"rate_hz": 8000.0}, "it is for another rate than the board runs at"),
        ("delay", {"delay_samples": 2}, "it is for another computing delay"),
        ("fingers", {"channels": display().channels}, "it is for another number of channels"),
    ):
        write_controller(f"{name}.json", controller(replace(display(channel()), **changes)))
        run.refused("image", image, "--controller", f"{name}.json", said=words)
    for spoilt, words in (
        (content[:-1], "it is truncated, or longer than it says"),
        (content + b"\0", "it is truncated, or longer than it says"),
        (content[:90] + bytes([content[90] ^ 4]) + content[91:], "its checksum does not fit"),
        (b"PNG!" + content[4:], "it is no image; allowed: a file that `build` wrote"),
    ):
        image.write_bytes(spoilt)
        run.refused("image", image, said=words)
