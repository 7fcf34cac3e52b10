# Figures of the maps of dynamics, named after the paper's labels.
#
# INPUTS   results/{run}/{dataset}/maps, floor plans
# OUTPUTS  paper_figures/{run}/<label>.{pdf,png,csv}
# STEPS    figure_cliff_hours, figure_stef_hours, figure_one_location, figure_mod_comparison; MAP_FIGURES collects them


rule figure_cliff_hours:
    """Time-conditioned CLiFF-maps of a few hours (the paper's fig:cliff-atc-time)."""
    input:
        maps=maps_of_label("tc_cliff"),
        floor_plan=floor_plan_of_label,
    output:
        csv=f"{EXHIBITS}/cliff-{{label}}-time.csv",
        pdf=f"{EXHIBITS}/cliff-{{label}}-time.pdf",
        png=report(
            f"{EXHIBITS}/cliff-{{label}}-time.png",
            caption="../report/cliff-time.rst",
            category="Maps",
            labels={"exhibit": "hourly TC-CLiFF-maps", "dataset": "{label}"},
        ),
    log:
        f"results/{RUN}/logs/figure_cliff_hours/{{label}}.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        dataset=lambda wildcards: settings_of(dataset_of_label(wildcards.label)),
        code=code_of("figure_cliff_hours"),
    message:
        "Figure cliff-{wildcards.label}-time"
    script:
        "../scripts/figure_cliff_hours.py"


rule figure_stef_hours:
    """STeF-maps of a few hours (the paper's fig:stef-atc-time)."""
    input:
        maps=maps_of_label("stef"),
        floor_plan=floor_plan_of_label,
    output:
        csv=f"{EXHIBITS}/stef-{{label}}-time.csv",
        pdf=f"{EXHIBITS}/stef-{{label}}-time.pdf",
        png=report(
            f"{EXHIBITS}/stef-{{label}}-time.png",
            caption="../report/stef-time.rst",
            category="Maps",
            labels={"exhibit": "hourly STeF-maps", "dataset": "{label}"},
        ),
    log:
        f"results/{RUN}/logs/figure_stef_hours/{{label}}.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        dataset=lambda wildcards: settings_of(dataset_of_label(wildcards.label)),
        code=code_of("figure_stef_hours"),
    message:
        "Figure stef-{wildcards.label}-time"
    script:
        "../scripts/figure_stef_hours.py"


rule figure_one_location:
    """CLiFF at one busy location, every hour and the whole day (fig:cliff-atc-time-one-location)."""
    input:
        maps=maps_of_label("tc_cliff", "cliff.parquet"),
    output:
        csv=f"{EXHIBITS}/cliff-{{label}}-time-one-location.csv",
        pdf=f"{EXHIBITS}/cliff-{{label}}-time-one-location.pdf",
        png=report(
            f"{EXHIBITS}/cliff-{{label}}-time-one-location.png",
            caption="../report/one-location.rst",
            category="Maps",
            labels={"exhibit": "CLiFF at one location", "dataset": "{label}"},
        ),
    log:
        f"results/{RUN}/logs/figure_one_location/{{label}}.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        dataset=lambda wildcards: settings_of(dataset_of_label(wildcards.label)),
        code=code_of("figure_one_location"),
    message:
        "Figure cliff-{wildcards.label}-time-one-location"
    script:
        "../scripts/figure_one_location.py"


rule figure_mod_comparison:
    """Time-conditioned CLiFF beside STeF at a few hours (the paper's fig:edin_mod)."""
    input:
        maps=maps_of_label("tc_cliff", "stef"),
        floor_plan=floor_plan_of_label,
    output:
        csv=f"{EXHIBITS}/{{label}}_mod.csv",
        pdf=f"{EXHIBITS}/{{label}}_mod.pdf",
        png=report(
            f"{EXHIBITS}/{{label}}_mod.png",
            caption="../report/mod.rst",
            category="Maps",
            labels={"exhibit": "TC-CLiFF and STeF", "dataset": "{label}"},
        ),
    log:
        f"results/{RUN}/logs/figure_mod_comparison/{{label}}.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        dataset=lambda wildcards: settings_of(dataset_of_label(wildcards.label)),
        code=code_of("figure_mod_comparison"),
    message:
        "Figure {wildcards.label}_mod"
    script:
        "../scripts/figure_mod_comparison.py"


MAP_FIGURES = [  # of the maps that the compared methods build
    expand(figure.output, label=LABELS)
    for figure, kinds in (
        (rules.figure_cliff_hours, {"tc_cliff"}),
        (rules.figure_stef_hours, {"stef"}),
        (rules.figure_one_location, {"tc_cliff", "cliff"}),
        (rules.figure_mod_comparison, {"tc_cliff", "stef"}),
    )
    if kinds <= KINDS_RUN
]
