"""What a subject or an operator reads comes from the language file: no word of the pages is left in the code."""

import ast
import re
from importlib.resources import files
from pathlib import Path

import tactuator.web

STATIC = files("tactuator.web").joinpath("static")
MODULES = (
    *("web/subject.py", "web/operator.py", "web/pages.py", "experiment/session/detection_task.py"),
    *("experiment/session/recognition_task.py", "experiment/session/judging_task.py"),
    *("experiment/protocol/detection.py", "experiment/protocol/recognition.py"),
)
SOURCES = Path(tactuator.web.__file__).parents[1]

LITERAL = re.compile(r'"((?:[^"\\\n]|\\.)*)"|`((?:[^`\\]|\\.)*)`')
NOT_SHOWN = {"use strict", "Enter", "Escape", "Tab", "Space", "matrix many"}
"""The mode of a script, names of keys, and a class of style."""


def left_in_script(source: str) -> list[str]:
    """Texts of a script that read as words: two in a row, or one that begins like a sentence."""
    code = re.sub(r"^\s*//.*$", "", source, flags=re.M)
    texts = [re.sub(r"\$\{[^}]*\}", "", one or other) for one, other in LITERAL.findall(code)]
    return [text for text in texts if text not in NOT_SHOWN and _reads_as_words(text)]


def left_in_page(source: str) -> list[str]:
    """Texts between the tags of a page, or in its labels, that come from no language file."""
    bare = re.sub(r"\{\{[a-z_.]+\}\}", "", source)
    texts = re.findall(r">([^<]+)<|(?:aria-label|title|alt|placeholder)=\"([^\"]*)\"", bare)
    return [text for pair in texts for text in pair if re.search("[A-Za-z]{2}", text)]


def left_in_module(source: str) -> list[str]:
    """Texts of a module that read as words, apart from its documentation, its parameters' and what it raises."""
    tree = ast.parse(source)
    aside = [node for node in ast.walk(tree) if isinstance(node, ast.Raise)]
    aside += [node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef) and node.name == "__post_init__"]
    aside += [node.annotation for node in ast.walk(tree) if isinstance(node, ast.AnnAssign)]
    quiet = {id(node) for part in aside for node in ast.walk(part)}
    quiet |= {id(one.value) for one in ast.walk(tree) if isinstance(one, ast.Expr)}
    texts = [one for one in ast.walk(tree) if isinstance(one, ast.Constant) and isinstance(one.value, str)]
    return [one.value for one in texts if id(one) not in quiet and _reads_as_words(one.value)]


def _reads_as_words(text: str) -> bool:
    if re.search(r"[<>={]|^by the subject|^.prefers-|^default-src", text):  # markup, a query, a header, an event
        return False
    return bool(re.search(r"[A-Za-z]{2,}[,:;]? [A-Za-z]{2,}", text) or re.fullmatch(r"[A-Z][a-z]+\W{0,2}", text))


def test_pages_their_scripts_and_the_modules_behind_them__have_no_word_of_their_own() -> None:
    texts = {name: left_in_module((SOURCES / name).read_text("utf-8")) for name in MODULES}
    for part in STATIC.iterdir():
        if part.name.endswith((".js", ".html")):
            left = left_in_script if part.name.endswith(".js") else left_in_page
            texts[part.name] = left(part.read_text("utf-8"))
    assert len(texts) > 20
    assert {name: words for name, words in texts.items() if words} == {}


def test_word_put_into_script_page_or_module__is_found() -> None:
    for worded in ('say("Please wait for the experimenter.")', '"Agree"', "`Sound on`"):
        assert left_in_script(f'say(word("wait")) + {worded};') == [re.split('["`]', worded)[1]]
    page = STATIC.joinpath("subject.html").read_text("utf-8")
    assert left_in_page(page.replace("{{page.pause}}", "Pause", 1)) == ["Pause"]
    assert left_in_page(page.replace("{{page.progress}}", "Progress", 1)) == ["Progress"]
    module = (SOURCES / "web/subject.py").read_text("utf-8")
    put = module.replace('type="playing"', 'type="playing", message="Feel your finger"', 1)
    assert left_in_module(put) == ["Feel your finger"]
