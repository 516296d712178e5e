# One image of the locked versions, for the workbook and for the sensor. `docker build -t workbook .`, then
#   docker run --rm workbook                                              the tests
#   docker run --rm -p 127.0.0.1:8888:8888 workbook make lab              JupyterLab; it prints the address to open
#   docker run --rm -v "$PWD:/logs" -w /logs --user "$(id -u):$(id -g)" workbook backlash estimate log.csv ...
FROM python:3.11-slim-bookworm@sha256:a36c24f9cbdf4fd0f52d67f0823eeac19c2028c637cecc392d97f980d4fec56b
RUN apt-get update && apt-get install --yes --no-install-recommends git make && rm -rf /var/lib/apt/lists/* \
    && useradd --create-home workbook && mkdir /workbook && chown workbook /workbook
USER workbook
WORKDIR /workbook
COPY --chown=workbook . .
RUN make .venv/.test .venv/.lab && .venv/bin/backlash estimate --help > /dev/null
ENV PATH="/workbook/.venv/bin:$PATH"
# JupyterLab is reached through a port that docker publishes: it has to listen on all addresses.
RUN mkdir -p ~/.jupyter && echo 'c.ServerApp.ip = "0.0.0.0"' > ~/.jupyter/jupyter_server_config.py
CMD ["make", "test"]
