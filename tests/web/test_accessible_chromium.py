"""The subject's page as a screen reader and a Braille line have it: Chromium's own accessibility tree."""

from tests.experiment.session.apparatuses import PROTOCOL, controller
from tests.web.study import asked, page, start, visible  # noqa: F401

NAMED = (
    PROTOCOL[: PROTOCOL.rindex("[[subject]]")].replace(
        "[study]",
        '[study]\nconsent_by = "name"\nconsent_witness = true\ninstructions = "Press the interval that you felt."',
    )
    + "[marks]\nchannel = 'thumb'\n"
)


def tree(page) -> list[tuple[str, str, dict]]:
    """Role, name and properties of every node that is not ignored."""
    session = page.context.new_cdp_session(page)
    session.send("Accessibility.enable")
    nodes = session.send("Accessibility.getFullAXTree")["nodes"]
    session.detach()
    return [
        (
            node.get("role", {}).get("value", ""),
            node.get("name", {}).get("value", ""),
            {one["name"]: one["value"].get("value") for one in node.get("properties", [])},
        )
        for node in nodes
        if not node["ignored"]
    ]


def names(page, role: str) -> list[str]:
    return [name for found, name, _ in tree(page) if found == role]


def focused(page) -> list[tuple[str, str]]:
    return [(role, name) for role, name, about in tree(page) if about.get("focused") and role != "RootWebArea"]


def test_page__without_eyes__is_read_from_consent_to_answer(start, page) -> None:
    page.set_viewport_size({"width": 390, "height": 844})
    page.goto(start(NAMED, controller()).addresses["subject S1"])
    visible(page, "Before we begin")
    assert page.evaluate("document.documentElement.lang") == "en"
    assert focused(page) == [("region", "Before we begin")]  # the text is what is read first
    assert "You may stop at any time." in names(page, "StaticText")
    assert names(page, "textbox") == ["Your name", "Name of the witness"]
    assert {"I agree (Enter)", "I do not agree"} <= set(names(page, "button"))
    page.locator("#name").fill("Ada Example")
    page.locator("#name").press("Enter")
    assert page.evaluate("page.stage") == "consent"  # the witness is missing
    page.locator("#witness").fill("Bob Example")
    page.locator("#witness").press("Enter")
    visible(page, "Which interval has the vibration?")
    assert focused(page)[0][0] == "region"
    page.keyboard.press("Enter")
    asked(page)
    status = next(about for role, name, about in tree(page) if role == "status")
    assert status["live"] == "polite"
    answers = [about for role, name, about in tree(page) if role == "button" and name in ("1", "2", "3")]
    assert len(answers) == 3
    assert not any(about.get("disabled") for about in answers)
    assert "Responses" in names(page, "group")
    assert "progressbar" in [role for role, _, _ in tree(page)] or "Progress" in str(tree(page))
    for name in ("Pause", "Leave the study"):
        assert name in names(page, "button")
    assert all(name for role, name, _ in tree(page) if role in ("button", "textbox", "link"))
    sizes = [page.locator(".choice").nth(number).bounding_box() for number in range(3)]
    assert all(size["width"] >= 100 and size["height"] >= 70 for size in sizes)  # large enough without sight
    page.locator(".choice").nth(1).click()
    visible(page, "Which")
