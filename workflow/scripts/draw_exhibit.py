"""Rules table_*, figure_* and page_*: one for each record of `modlhmp.study.exhibits`."""

from dataclasses import replace
from importlib import import_module

from modlhmp.datasets import Dataset
from modlhmp.logs import job_log
from modlhmp.settings import build
from modlhmp.study.layout import Layout

with job_log(snakemake.log[0]):
    params = snakemake.params
    layout = Layout.around(params.run, snakemake.output[0])
    datasets = [build(Dataset, plain) for plain in params.datasets]
    datasets = [replace(one, floor_plan=[*map(layout.here, one.floor_plan)]) for one in datasets]
    shown = datasets[0] if params.per_dataset else datasets
    draw = getattr(import_module(params.module), params.function)
    draw(layout, shown, snakemake.output[0].rpartition(".")[0], **params.asks)
