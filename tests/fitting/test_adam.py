"""Our Adam takes the steps of torch's, to the last bit."""

import math

import torch

from hand_recon.fitting.adam import Adam


def test_steps_are_those_of_torchs_adam() -> None:
    start = [torch.randn(3, 4), torch.randn(3)]
    ours = [value.clone().requires_grad_() for value in start]
    theirs = [value.clone().requires_grad_() for value in start]
    optimizer = Adam(ours, [1.0, 0.6], betas=(0.9, 0.99))
    reference = torch.optim.Adam(
        [{"params": [theirs[0]], "share": 1.0}, {"params": [theirs[1]], "share": 0.6}],
        betas=(0.9, 0.99),
    )
    for step in range(20):
        rate = 0.1 * 0.5 * (1 + math.cos(math.pi * step / 20))
        for values in (ours, theirs):
            loss = (values[0].sin() * values[1][:, None]).sum() + values[1].square().sum()
            if values is ours:
                optimizer.step(torch.autograd.grad(loss, values), rate)
                continue
            reference.zero_grad()
            loss.backward()
            for group in reference.param_groups:
                group["lr"] = rate * group["share"]
            reference.step()
    for one, other in zip(ours, theirs, strict=True):
        assert torch.equal(one, other)
