# How good forecasts are as distributions: with all samples, which are forecast again and not stored.
#
# INPUTS   clean test tracks, the method's map and ways out
# OUTPUTS  results/{run}/{dataset}/uncertainty/{method}.parquet; paper_figures/{run}/tab_uncertainty.{csv,tex,md,html},
#          calibration.{pdf,png,csv}, density.{pdf,png,csv}
# STEPS    measure_uncertainty; table_uncertainty, figure_calibration, figure_density; UNCERTAINTY_TABLES and
#          UNCERTAINTY_FIGURES collect them
MEASURED = [name for name in TITLES if name in config["uncertainty"]["methods"]]
UNCERTAINTY_FILES = expand(
    f"results/{RUN}/{{dataset}}/uncertainty/{{method}}.parquet",
    dataset=DATASETS,
    method=MEASURED,
)


rule measure_uncertainty:
    """Energy score, best of five, expected error and probability of having left, by track and seed."""
    input:
        tracks=track_files("test"),
        map=method_map,
        exits=method_exits,
    output:
        f"results/{RUN}/{{dataset}}/uncertainty/{{method}}.parquet",
    log:
        f"results/{RUN}/logs/measure_uncertainty/{{dataset}}/{{method}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/measure_uncertainty/{{dataset}}/{{method}}.tsv"
    wildcard_constraints:
        method="|".join(MEASURED) or NO_METHOD,
    resources:
        mem_mb=1500,
        runtime=60,
    params:
        method=lambda wildcards: method_of(wildcards.dataset, wildcards.method),
        samples=config["uncertainty"]["samples"],
        dataset=lambda wildcards: settings_of(wildcards.dataset, FORECAST_KEYS),
        recordings=lambda wildcards: [
            r["name"] for r in recordings(wildcards.dataset, "test")
        ],
        seeds=config["seeds"],
        horizons=config["tables"]["horizons_s"],
        code=code_of("measure_uncertainty"),
    message:
        "Measure the distribution of {wildcards.method} on {wildcards.dataset}"
    script:
        "../scripts/measure_uncertainty.py"


rule table_uncertainty:
    """Scores of the distributions of every method, dataset and horizon."""
    input:
        UNCERTAINTY_FILES,
    output:
        **table_files("tab_uncertainty"),
    log:
        f"results/{RUN}/logs/table_uncertainty.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        datasets=SETTINGS,
        methods={name: TITLES[name] for name in MEASURED},
        code=code_of("table_uncertainty"),
    message:
        "Table of distributions"
    script:
        "../scripts/table_uncertainty.py"


rule figure_calibration:
    """Are errors as large as expected, and do people leave as often as said?"""
    input:
        UNCERTAINTY_FILES,
    output:
        csv=f"{EXHIBITS}/calibration.csv",
        pdf=f"{EXHIBITS}/calibration.pdf",
        png=report(
            f"{EXHIBITS}/calibration.png",
            caption="../report/calibration.rst",
            category="Figures",
            labels={"exhibit": "calibration", "dataset": "all"},
        ),
    log:
        f"results/{RUN}/logs/figure_calibration.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        datasets=SETTINGS,
        methods=TITLES,
        measured=MEASURED,
        code=code_of("figure_calibration"),
    message:
        "Figure calibration"
    script:
        "../scripts/figure_calibration.py"


SHOWN_DENSITY = "snippets" if "snippets" in MEASURED else next(iter(MEASURED), None)


rule figure_density:
    """Where one person of each dataset may be at three moments."""
    input:
        [
            f"results/{RUN}/{dataset}/{file}"
            for dataset in DATASETS
            for file in (
                *(f"tracks/{r['name']}.parquet" for r in recordings(dataset, "test")),
                f"errors/{next(iter(TITLES))}.parquet",
            )
        ],
        maps=[map_of(dataset, SHOWN_DENSITY) for dataset in DATASETS if SHOWN_DENSITY],
        exits=[
            exits_of(dataset, SHOWN_DENSITY) for dataset in DATASETS if SHOWN_DENSITY
        ],
        floor_plans=[file for one in DATASETS.values() for file in one["floor_plan"]],
    output:
        csv=f"{EXHIBITS}/density.csv",
        pdf=f"{EXHIBITS}/density.pdf",
        png=report(
            f"{EXHIBITS}/density.png",
            caption="../report/density.rst",
            category="Forecasts",
            labels={"exhibit": "density of a forecast", "dataset": "all"},
        ),
    log:
        f"results/{RUN}/logs/figure_density.log",
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        datasets=SETTINGS,
        methods=TITLES,
        shown=SHOWN_DENSITY,
        forecast_by={
            name: method_of(name, SHOWN_DENSITY) for name in DATASETS if SHOWN_DENSITY
        },
        samples=config["uncertainty"]["samples"],
        seed=config["seeds"][0],
        code=code_of("figure_density"),
    message:
        "Figure density"
    script:
        "../scripts/figure_density.py"


UNCERTAINTY_TABLES = rules.table_uncertainty.output if MEASURED else []
UNCERTAINTY_FIGURES = (
    [rules.figure_calibration.output, rules.figure_density.output] if MEASURED else []
)
