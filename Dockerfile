# The demo, whose page is then in out/stiction-demo. As the user who owns the folder out, since nobody else may write there:
#   docker build -t stiction . && mkdir -p out && docker run --rm --user "$(id -u):$(id -g)" -v "$PWD/out:/out" stiction
# Built and run with Buildah 1.28, with a base made of Debian 12's own packages in place of the official one, which could
# not be had; never with Docker.
FROM python:3.11-slim-bookworm AS wheel
WORKDIR /source
COPY pyproject.toml README.md LICENSE ./
COPY src src
RUN pip wheel --no-cache-dir --no-deps --wheel-dir /wheels .

FROM python:3.11-slim-bookworm
# What rendering needs; without it the demo leaves its clips out.
RUN apt-get update \
 && apt-get install --yes --no-install-recommends libegl1 libgl1 libgl1-mesa-dri \
 && rm -rf /var/lib/apt/lists/*
COPY --from=wheel /wheels /wheels
COPY requirements.lock /
# The versions that were tested, without their hashes: torch and what else the demo does not need is not installed.
RUN sed -n -e 's/^\([A-Za-z0-9._-]*==[0-9][^ ;]*\).*/\1/p' /requirements.lock > /constraints.txt \
 && pip install --no-cache-dir --constraint /constraints.txt "$(ls /wheels/stiction-*.whl)[sim]" \
 && useradd --create-home someone && mkdir /out && chown someone /out
USER someone
WORKDIR /out
# A user who is not in the image has no home.
ENV HOME=/tmp MUJOCO_GL=egl STICTION_THREADS=2
ENTRYPOINT ["stiction"]
CMD ["demo", "--out", "/out/stiction-demo"]
