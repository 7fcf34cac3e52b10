"""Rule write_report."""

from modlhmp.datasets import Dataset
from modlhmp.logs import job_log
from modlhmp.settings import build
from modlhmp.study.layout import Layout
from modlhmp.study.report.page import write
from modlhmp.study.report.rule_graph import RuleGraph

with job_log(snakemake.log[0]):
    params = snakemake.params
    datasets = [build(Dataset, plain) for plain in params.datasets]
    layout = Layout.around(params.run, snakemake.output[0])
    graph = RuleGraph(*params.graph)
    write(layout, datasets, snakemake.output[0], **params.about, graph=graph, rules=params.rules)
