# The workflow with all its packages, hash-checked, run by a user without rights and without network:
#
#     docker build -t localhost/modlhmp .
#     docker run --network none --name modlhmp localhost/modlhmp
#     docker cp modlhmp:/modlhmp/paper_figures .
FROM python:3.11-slim
RUN apt-get update && apt-get install -y --no-install-recommends git make rsync && rm -rf /var/lib/apt/lists/*
RUN useradd --create-home walker && mkdir /modlhmp && chown walker /modlhmp
USER walker
WORKDIR /modlhmp
COPY --chown=walker . .
RUN make environment
ENV PATH=/modlhmp/.venv/bin:$PATH
CMD ["make", "reproduce"]
