"""Language files: the same keys everywhere, and refused in one line where they are not."""

import pytest

from tactuator.errors import BadInput
from tactuator.experiment.words import difference, read_words, shipped_languages, shipped_words

ENGLISH = shipped_words("en").texts


def test_languages__shipped__are_english_and_two_more_with_the_same_keys_and_names() -> None:
    assert set(shipped_languages()) >= {"en", "de", "fr"}
    for language in shipped_languages():
        texts = shipped_words(language).texts
        assert difference(texts, ENGLISH) is None, language
        same = {key for key, text in texts.items() if text == ENGLISH[key] and len(text) > 12}
        assert language == "en" or same <= {"operator.minutes", "operator.rig", "run.title"}
    with pytest.raises(BadInput, match="language 'tlh'; allowed: de, en, fr, or a language_file"):
        shipped_words("tlh")


def written(tmp_path, change):
    tables: dict[str, list[str]] = {}
    for key, text in change(dict(ENGLISH)).items():
        table, _, name = key.partition(".")
        quoted = text.replace('"', '\\"')
        tables.setdefault(table, []).append(f'{name} = "{quoted}"')
    (tmp_path / "xx.toml").write_text("".join(f"[{name}]\n" + "\n".join(each) + "\n" for name, each in tables.items()))
    return tmp_path / "xx.toml"


def test_language_file__of_ones_own__is_read(tmp_path) -> None:
    words = read_words(written(tmp_path, lambda texts: texts | {"page.done": "Finis."}), "la")
    assert (words("page.done"), words("page.wrong", right="2"), words.language) == ("Finis.", "No, it was 2", "la")
    (tmp_path / "bytes.toml").write_bytes(b"\xff")
    (tmp_path / "broken.toml").write_bytes(b"[page\n")
    for name in ("missing.toml", "bytes.toml", "broken.toml"):
        with pytest.raises(BadInput, match=r"language file .*allowed: TOML as the shipped files are"):
            read_words(tmp_path / name, "la")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda texts: {k: v for k, v in texts.items() if k != "page.done"}, "keys missing: page.done; beyond: none"),
        (lambda texts: texts | {"page.more": "x"}, "keys missing: none; beyond: page.more"),
        (lambda texts: texts | {"page.wrong": "No."}, "page.wrong puts in nothing; allowed: right"),
        (lambda texts: texts | {"page.wrong": "No, {right"}, "page.wrong puts in a brace"),
        (lambda texts: texts | {"page.done": ""}, "page.done has 0 characters"),
        (lambda texts: texts | {"page.done": "x" * 401}, "page.done has 401 characters"),
    ],
)
def test_language_file__that_is_not_whole__is_refused_in_one_line(tmp_path, change, words) -> None:
    with pytest.raises(BadInput, match=words) as told:
        read_words(written(tmp_path, change), "la")
    assert "\n" not in str(told.value)
