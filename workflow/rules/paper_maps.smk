# Figures of the maps of dynamics, named after the paper's labels.
#
# INPUTS   results/{run}/{dataset}/maps, floor plans
# OUTPUTS  paper_figures/{run}/<label>.{pdf,png,csv}
# STEPS    figure_hourly_maps; MAP_FIGURES collects them


rule figure_hourly_maps:
    """Time-conditioned CLiFF-maps of a few hours (the paper's fig:cliff-atc-time)."""
    input:
        maps=lambda wildcards: f"results/{RUN}/{dataset_of_label(wildcards.label)}/maps/tc_cliff",
    output:
        csv=f"{EXHIBITS}/cliff-{{label}}-time.csv",
        pdf=f"{EXHIBITS}/cliff-{{label}}-time.pdf",
        png=report(
            f"{EXHIBITS}/cliff-{{label}}-time.png",
            caption="../report/cliff-time.rst",
            category="Maps",
            labels={"exhibit": "hourly TC-CLiFF maps", "dataset": "{label}"},
        ),
    log:
        f"results/{RUN}/logs/figure_hourly_maps/{{label}}.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        dataset=lambda wildcards: settings_of(dataset_of_label(wildcards.label)),
        code=code_version("modlhmp.paper.hourly_maps", *PAPER_STYLE),
    message:
        "Figure cliff-{wildcards.label}-time"
    script:
        "../scripts/figure_hourly_maps.py"


MAP_FIGURES = []  # of the maps that the compared methods build
if "tc_cliff" in KINDS_RUN:
    MAP_FIGURES += expand(rules.figure_hourly_maps.output, label=LABELS)
