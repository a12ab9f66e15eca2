"""Training on one GPU in minutes, on a machine without network: images in one file, one script.

Where the photographs are (Hydra's environment, any processor):

    PYTHONPATH=.:tools python -m gpu.pack labels.json --test test.json --images photos --out carried

writes `carried/hands.npz` (crops and labels) and `carried/backbone.pth` (ImageNet weights of
EfficientNet-Lite0 in half precision), says how large they are, and names the packages that the other
machine may lack. The photographs' licence holds for `hands.npz` too: it is never committed. With
`--hands-in-3d any_pose:500` there are rendered test hands with 3D, for PA-MPJPE; with `--exchanged 6000`
further training hands with fingers of others, as `recipe=photos` has them. 13,426 hands have 29 MiB, and
with 8,000 such hands 37 MiB at `--quality 70`.

On the machine with the GPU, which needs PyTorch, Lightning, SciPy, safetensors and jaxtyping, and for
rendered hands OpenCV and embreex, but neither Hydra nor a network:

    PYTHONPATH=.:tools python -m gpu.train carried --out trained --minutes 9

trains rows 1, 4 and 5 of Table 1 one after another at 224 pixels and writes `trained/report.json` and the
weights after each row, or those of `--saved-rows 5` alone. `--backbone resnet50` starts from random
weights, or from `--weights <file>`. The time is a limit: rendering, rows and their evaluation share it, and
the learning rate follows each row's share. Decision 72 has what was measured.

    packed.py     the file of crops and labels
    pack.py       command: photographs → files to carry
    resident.py   crops in the device's memory, batches of them
    rendered.py   hands rendered by processes beside
    rows.py       networks, priors and data terms without Hydra
    precision.py  bfloat16 and compilation of the convolutions
    training.py   one row
    scoring.py    its scores
    weights.py    its weights as files
    session.py    all rows within the time
    train.py      command
"""
