"""Rule make_demo_recording."""

from modlhmp.logs import job_log
from modlhmp.study.demo import write_recording

with job_log(snakemake.log[0]) as log:
    day = snakemake.params.day
    log.info("planted: %s", write_recording(snakemake.output[0], day["site"], day["day"], **snakemake.params.demo))
