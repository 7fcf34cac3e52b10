"""Rule make_demo_floor_plan."""

from modlhmp.logs import job_log
from modlhmp.study.demo.hall import write_floor_plan

with job_log(snakemake.log[0]):
    write_floor_plan(snakemake.output.yaml)
