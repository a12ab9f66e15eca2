# docker build -t hand_recon .
# docker run --rm -v "$PWD/runs:/workspace" hand_recon +experiment=ablation_row3
#
# Arguments of `docker run` are Hydra overrides. With `--gpus all` it trains on the GPU: the locked PyTorch
# carries CUDA, which is most of the image's size. docs/docker.md tells the rest.
ARG BASE_IMAGE=python:3.12-slim
FROM ${BASE_IMAGE}

# torch.compile writes C++ and compiles it when it first runs.
RUN apt-get update \
 && apt-get install --yes --no-install-recommends g++ \
 && rm -rf /var/lib/apt/lists/*

# Not root, with the number that the first user of most machines has, so that results on a mounted folder
# belong to that user.
RUN useradd --uid 1000 --create-home hand \
 && mkdir /application /workspace /opt/venv \
 && chown hand /application /workspace /opt/venv
USER hand
WORKDIR /application

ENV PATH=/opt/venv/bin:$PATH \
    PYTHONUNBUFFERED=1 \
    UV_LINK_MODE=copy \
    UV_NO_CACHE=1 \
    VIRTUAL_ENV=/opt/venv

# The packages come before the code, so that changing the code does not install them again. Every one is at
# its locked version and verified by the lock's hashes; the development tools of the lock are left out.
COPY --chown=hand pyproject.toml requirements.lock ./
RUN python3 -m venv /opt/venv \
 && awk '/^[^ ]/ { wanted = /^uv==/ } wanted' requirements.lock > /tmp/uv.txt \
 && pip install --no-cache-dir --disable-pip-version-check --require-hashes -r /tmp/uv.txt \
 && uv pip install --verify-hashes --constraints requirements.lock \
      --build-constraints requirements.lock --requirements pyproject.toml --extra train --extra backbone --extra detect

# Editable, so that users of the image edit the configuration beside the package.
COPY --chown=hand README.md LICENSE NOTICE ./
COPY --chown=hand conf conf
COPY --chown=hand hydra_plugins hydra_plugins
COPY --chown=hand hand_recon hand_recon
RUN uv pip install --no-deps --build-constraints requirements.lock --editable .

# Everything that is written, rendered or kept goes here.
ENV HAND_RECON_OUTPUT=/workspace/outputs \
    HAND_RECON_CACHE=/workspace/cache
VOLUME /workspace

ENTRYPOINT ["python", "-m", "hand_recon.train"]
