"""Compiled backbones: which modules, the same values, and clear refusals."""

from collections.abc import Iterator

import pytest
import torch
from jaxtyping import config
from torch import nn

from hand_recon.hand.open_hand import open_hand
from hand_recon.regressor import compiling
from hand_recon.regressor.backbones import Backbone, build_backbone
from hand_recon.regressor.compiling import compile_backbones, compiler_problem


@pytest.fixture
def working(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """A machine on which torch.compile works, with the backend that runs a graph as it is."""
    whole = nn.Module.compile
    monkeypatch.setattr(compiling, "compiler_problem", lambda device: None)
    monkeypatch.setattr(nn.Module, "compile", lambda module: whole(module, backend="eager"))
    # The checks of shapes that tests add are no part of a user's graph; PyTorch 2.11 fails on them.
    before = config.jaxtyping_disable
    config.update("jaxtyping_disable", True)
    yield
    config.update("jaxtyping_disable", before)


@pytest.mark.usefixtures("working")
def test_the_backbone_is_compiled_and_its_weights_keep_their_names() -> None:
    torch.manual_seed(0)
    backbone = build_backbone("resnet18", "none").eval()
    network = nn.Sequential(nn.Identity(), backbone)
    names, images = list(network.state_dict()), torch.rand(2, 3, 64, 64)
    with torch.no_grad():
        expected = backbone(images)
        assert compile_backbones(network, "cpu") == 1
        found = backbone(images)
    assert list(network.state_dict()) == names
    for stride, features in expected.items():
        torch.testing.assert_close(found[stride], features)


@pytest.mark.usefixtures("working")
def test_only_backbones_are_compiled(monkeypatch: pytest.MonkeyPatch) -> None:
    chosen: list[nn.Module] = []
    # A function, so that it is bound to the module.
    monkeypatch.setattr(nn.Module, "compile", lambda module: chosen.append(module))
    network = nn.ModuleList([open_hand(), build_backbone("resnet18", "none"), nn.Linear(2, 2)])
    compile_backbones(network, "cpu")
    assert [isinstance(module, Backbone) for module in chosen] == [True]


def test_a_network_without_a_backbone_is_refused() -> None:
    with pytest.raises(ValueError, match="this model has none"):
        compile_backbones(nn.Linear(2, 2), "cpu")


def test_a_machine_without_a_compiler_is_told_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(function: object) -> object:
        raise RuntimeError("No working C++ compiler found")

    compiler_problem.cache_clear()
    monkeypatch.setattr(compiling, "one_graph", broken)
    try:
        with pytest.raises(
            ValueError, match=r"No working C\+\+ compiler found.*Install .*compile=false"
        ):
            compile_backbones(build_backbone("resnet18", "none"), "cpu")
    finally:
        compiler_problem.cache_clear()
