# The workflow's environment as an image: docker build -t localhost/modlhmp .
FROM python:3.11-slim
RUN apt-get update && apt-get install -y --no-install-recommends make git && rm -rf /var/lib/apt/lists/*
WORKDIR /modlhmp
COPY . .
RUN make environment
ENV PATH=/modlhmp/.venv/bin:$PATH
