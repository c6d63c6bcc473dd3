"""`tactuator firmware wordlength`, `build` and `firmware image`, as a user runs them."""

from tactuator.io.controller import read_controller, write_controller
from tactuator.model.controller import Limits
from tests.runtime.paper_display import changed, controller, display, louder


def test_wordlength__another_rate_and_a_figure__bits_and_float32_are_told_and_drawn(desk, run) -> None:
    reported = run.json("firmware", "wordlength", "controller.json", "--rate", "2000", "--figures", "figures")
    assert set(reported) == {"rate_hz", "bits", "float32", "figures"}
    assert (reported["rate_hz"], reported["figures"]) == (2000.0, "figures")
    assert set(reported["bits"]) == {"prefilter", "feedback"}
    for forms in reported["bits"].values():
        assert set(forms) == {"direct", "sections", "delta"}
        for by_rate in forms.values():
            assert list(by_rate) == ["2000.0", "4000.0", "8000.0", "16000.0"]
            assert all(0 <= bits["stable"] <= bits["accurate"] for bits in by_rate.values())
    figures = {"response_error_db", "roundoff_db_sl", "limit_cycle_db_sl"}
    assert set(reported["float32"]) == {"stable", "safe", "refused"} | figures
    assert reported["float32"]["safe"]
    assert sorted(path.name for path in (desk / "figures").iterdir()) == ["resolution.csv", "resolution.svg"]


def test_loop_that_does_not_close__float32_is_not_safe_and_no_image_is_built(desk, run) -> None:
    write_controller("controller.json", louder(read_controller("controller.json"), 60.0))
    ended = run("firmware", "wordlength", "controller.json")
    assert ended.status == 1
    assert "float32: not safe" in ended.out
    (desk / "image.bin").write_bytes(b"TACI old")
    words = "float32 is not safe for this controller (unstable); expected what `firmware wordlength` calls safe"
    run.refused("build", "controller.json", "--out", "image.bin", said=words)
    assert (desk / "image.bin").read_bytes() == b"TACI old"


def test_build__twice_then_image__same_bytes_and_say_the_same_of_them(desk, run) -> None:
    image = desk / "image.bin"
    words = ("build", "controller.json", "--out", image)
    assert run(*words).status == 0
    before, built = image.read_bytes(), run.json(*words)
    assert image.read_bytes() == before
    assert (built["image"], built["bytes"]) == (str(image), len(before))
    assert (built["rate_hz"], built["channels"]) == (4000.0, 1)
    assert built["controller"] == read_controller("controller.json").content_hash
    assert 0.0 <= built.pop("response_error_db") < 1e-3
    read = run.json("firmware", "image", image, "--controller", "controller.json")
    assert (read.pop("is_of_controller"), read["delay_samples"]) == (True, 1)
    assert read == built
    assert built["crc32"] in run("firmware", "image", image).out
    spoilt = changed(read_controller("controller.json"), limits=Limits(9.0, 2.0))
    write_controller("controller.json", spoilt)
    assert (
        run.json("firmware", "image", image, "--controller", "controller.json", status=1)["is_of_controller"] is False
    )


def test_image__spoilt_or_for_another_display__is_refused(desk, run) -> None:
    """The core's refusals by name: tests/runtime/test_image."""
    image = desk / "image.bin"
    assert run("build", "controller.json", "--out", image).status == 0
    write_controller("fingers.json", controller(display()))
    run.refused("firmware", "image", image, "--controller", "fingers.json", said="it is for another number of channels")
    image.write_bytes(image.read_bytes()[:-1])
    run.refused("firmware", "image", image, said="it is truncated, or longer than it says")
