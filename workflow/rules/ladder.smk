# The ladder from the paper's configuration to the best one, a change a row (not in the paper).
#
# INPUTS   errors of its methods; for costs their maps and weights
# OUTPUTS  results/{run}/{dataset}/costs.json, ladder/{scores,differences}.parquet;
#          paper_figures/{run}/ladder-{label}.{csv,tex,md,html}, ladder.{pdf,png,csv}
# STEPS    measure_costs, climb_ladder, table_ladder, figure_ladder
RUNGS = [method for method, _ in ladder_rows(config)]
LADDER_METHODS = ladder_methods(config)
COSTED = list(
    dict.fromkeys(part for name in RUNGS for part in averaged_parts(config, name))
)


rule measure_costs:
    """Time of a forecast by each rung, on one core, observing included."""
    input:
        tracks=track_files("test"),
        maps=lambda wildcards: sorted(
            {
                str(map_path(f"results/{RUN}/{wildcards.dataset}/maps", kind))
                for kind in {METHODS[name]["kind"] for name in COSTED}
                if kind in MAP_KINDS
            }
        ),
        exits=lambda wildcards: f"results/{RUN}/{wildcards.dataset}/maps/exits.parquet",
        weights=lambda wildcards: [
            f"results/{RUN}/{wildcards.dataset}/models/{name}.pt"
            for name in COSTED
            if name in LEARNED
        ],
    output:
        f"results/{RUN}/{{dataset}}/costs.json",
    log:
        f"results/{RUN}/logs/measure_costs/{{dataset}}.log",
    threads: 1000  # capped to all there are, so it runs alone
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        methods=lambda wildcards: {
            name: method_of(wildcards.dataset, name) for name in COSTED
        },
        averages={
            name: averaged_parts(config, name) for name in RUNGS if name in AVERAGES
        },
        dataset=lambda wildcards: settings_of(wildcards.dataset, STUDY_KEYS),
        code=code_of("measure_costs"),
    message:
        "Costs of the ladder on {wildcards.dataset}"
    script:
        "../scripts/measure_costs.py"


rule climb_ladder:
    """Errors of every rung and paired differences, with bootstrap intervals over persons or days."""
    input:
        [
            f"results/{RUN}/{{dataset}}/errors/{method}.parquet"
            for method in LADDER_METHODS
        ],
    output:
        scores=f"results/{RUN}/{{dataset}}/ladder/scores.parquet",
        differences=f"results/{RUN}/{{dataset}}/ladder/differences.parquet",
    log:
        f"results/{RUN}/logs/climb_ladder/{{dataset}}.log",
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        ladder=config["ladder"],
        dataset=lambda wildcards: settings_of(
            wildcards.dataset, ("name", "time_step_s", "horizon_s")
        ),
        days=lambda wildcards: {
            r["name"]: r["day"] for r in recordings(wildcards.dataset, "test")
        },
        horizons=config["ladder"]["horizons_s"],
        code=code_of("climb_ladder"),
    message:
        "Ladder of {wildcards.dataset}"
    script:
        "../scripts/climb_ladder.py"


rule table_ladder:
    """The rungs of one dataset, each compared with the one above and with the reference."""
    input:
        scores=lambda wildcards: f"results/{RUN}/{dataset_of_label(wildcards.label)}/ladder/scores.parquet",
        differences=lambda wildcards: f"results/{RUN}/{dataset_of_label(wildcards.label)}/ladder/differences.parquet",
        costs=lambda wildcards: f"results/{RUN}/{dataset_of_label(wildcards.label)}/costs.json",
    output:
        **{kind: f"{EXHIBITS}/ladder-{{label}}.{kind}" for kind in ("csv", "tex", "md")},
        html=report(
            f"{EXHIBITS}/ladder-{{label}}.html",
            caption="../report/ladder.rst",
            category="Tables",
            labels={"exhibit": "ladder", "dataset": "{label}"},
        ),
    log:
        f"results/{RUN}/logs/table_ladder/{{label}}.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        dataset=lambda wildcards: settings_of(dataset_of_label(wildcards.label)),
        ladder=config["ladder"],
        titles=titles_of(LADDER_METHODS),
        days=lambda wildcards: sorted(
            {r["day"] for r in recordings(dataset_of_label(wildcards.label), "test")}
        ),
        code=code_of("table_ladder"),
    message:
        "Table ladder-{wildcards.label}"
    script:
        "../scripts/table_ladder.py"


rule figure_ladder:
    """ADE of every rung with its interval, all datasets."""
    input:
        [f"results/{RUN}/{dataset}/ladder/scores.parquet" for dataset in DATASETS],
    output:
        csv=f"{EXHIBITS}/ladder.csv",
        pdf=f"{EXHIBITS}/ladder.pdf",
        png=report(
            f"{EXHIBITS}/ladder.png",
            caption="../report/ladder.rst",
            category="Studies",
            labels={"exhibit": "ladder", "dataset": "all"},
        ),
    log:
        f"results/{RUN}/logs/figure_ladder.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        datasets=SETTINGS,
        ladder=config["ladder"],
        titles=titles_of(RUNGS),
        with_memory=[
            name
            for name in RUNGS
            if METHODS[name]["kind"] in BEYOND_KINDS
            and METHODS[name]["options"].get("grids", True)  # else it knows no place
        ],
        code=code_of("figure_ladder"),
    message:
        "Figure ladder"
    script:
        "../scripts/figure_ladder.py"
