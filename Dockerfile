# Two images of the locked versions. The sensor alone, small: `docker build --target sensor -t backlash .`, then in a
# folder of logs `docker run --rm -v "$PWD:/logs" --user "$(id -u):$(id -g)" backlash estimate log.csv ...`.
# The workbook: `docker build -t workbook .`, then `docker run --rm workbook make test`; JupyterLab:
# `docker run --rm -p 127.0.0.1:8888:8888 workbook make lab`, which prints the address to open.
FROM python:3.11-slim-bookworm@sha256:a36c24f9cbdf4fd0f52d67f0823eeac19c2028c637cecc392d97f980d4fec56b AS base

FROM base AS sensor
WORKDIR /sensor
COPY pyproject.toml README.md LICENSE requirements.lock ./
COPY replication replication
COPY backlash backlash
RUN sed -nE 's/^([^ ].*) \\$/\1/p' requirements.lock > versions \
    && pip install --no-cache-dir --constraint versions '.[xlsx,parquet,plot]' \
    && useradd --create-home sensor
# Whoever runs it may write there: what was compiled, and matplotlib's fonts.
ENV XDG_CACHE_HOME=/tmp/cache MPLCONFIGDIR=/tmp/cache/matplotlib
USER sensor
WORKDIR /logs
ENTRYPOINT ["backlash"]

FROM base AS workbook
RUN apt-get update && apt-get install --yes --no-install-recommends git make && rm -rf /var/lib/apt/lists/* \
    && useradd --create-home workbook && mkdir /workbook && chown workbook /workbook
USER workbook
WORKDIR /workbook
COPY --chown=workbook . .
RUN make .venv/.installed
# Outside the container JupyterLab is reached through a port that docker publishes: it has to listen on all addresses.
RUN mkdir -p ~/.jupyter && echo 'c.ServerApp.ip = "0.0.0.0"' > ~/.jupyter/jupyter_server_config.py
CMD ["make", "test"]
