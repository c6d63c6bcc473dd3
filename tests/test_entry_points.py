"""Entry points of other packages: found by name, and refused with the package's name where they cannot be loaded."""

import pytest

from tactuator.entry_points import plugin, plugins
from tactuator.errors import BadInput

GROUP = "tactuator.procedures"


def test_plugin__another_package_declares_it__what_it_refers_to(install):
    install(GROUP, "staircase", "class Keys:\n    pass\n", "Keys")
    assert "staircase" in plugins(GROUP)
    assert plugin(GROUP, "staircase").__name__ == "Keys"


def test_plugin__nobody_declares_it__names_of_all_there_are():
    with pytest.raises(BadInput, match=r"'stairs'; allowed: .*") as refused:
        plugin(GROUP, "stairs")
    assert refused.value.where == (GROUP,)
    with pytest.raises(BadInput, match=r"none: no package declares no.such.group"):
        plugin("no.such.group", "stairs")


@pytest.mark.parametrize(("source", "reason"), [("import no_such_module", "ModuleNotFoundError"), ("1 / 0", "ZeroDiv")])
def test_plugin__cannot_be_loaded__package_and_reason_are_named(install, source, reason):
    install(GROUP, "staircase", f"{source}\n", "Keys")
    with pytest.raises(BadInput, match=f"'staircase' of foreign_laboratory 1.0 .* cannot be loaded: {reason}"):
        plugin(GROUP, "staircase")


def test_plugins__two_packages_give_one_name_different_things__both_are_named(install):
    install(GROUP, "staircase", "class Keys:\n    pass\n", "Keys")
    install(GROUP, "staircase", "class Others:\n    pass\n", "Others", package="second_laboratory")
    with pytest.raises(BadInput, match=r"declared by foreign_laboratory.* and second_laboratory"):
        plugins(GROUP)
