# The locked environment and the workbook: `docker build -t workbook .`, then `docker run --rm workbook make test`;
# JupyterLab: `docker run --rm -p 8888:8888 workbook make lab`.
FROM python:3.11-slim-bookworm
RUN apt-get update && apt-get install --yes --no-install-recommends git make && rm -rf /var/lib/apt/lists/*
WORKDIR /workbook
COPY . .
RUN make .venv/.installed
CMD ["make", "test"]
