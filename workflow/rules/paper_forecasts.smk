# Figures of example forecasts, named after the paper's labels.
#
# INPUTS   clean test tracks, forecasts and errors of every method, floor plans
# OUTPUTS  paper_figures/{run}/<label>.{pdf,png,csv}
# STEPS    figure_ranked_forecasts, figure_prediction_examples, figure_memory_maps; FORECAST_FIGURES collects them
EXAMPLE_FILES = [
    f"results/{RUN}/{dataset}/{file}"
    for dataset in DATASETS
    for file in (
        *(f"tracks/{r['name']}.parquet" for r in recordings(dataset, "test")),
        *(f"errors/{method}.parquet" for method in TITLES),
        *(
            f"forecasts/{method}/{r['name']}.parquet"
            for method in TITLES
            for r in recordings(dataset, "test")
        ),
    )
]


rule figure_ranked_forecasts:
    """The ranked futures of an example track of each dataset (the paper's fig:rank)."""
    input:
        EXAMPLE_FILES,
        floor_plans=[file for one in DATASETS.values() for file in one["floor_plan"]],
    output:
        csv=f"{EXHIBITS}/rank.csv",
        pdf=f"{EXHIBITS}/rank.pdf",
        png=report(
            f"{EXHIBITS}/rank.png",
            caption="../report/rank.rst",
            category="Forecasts",
            labels={"exhibit": "ranked forecasts", "dataset": "all"},
        ),
    log:
        f"results/{RUN}/logs/figure_ranked_forecasts.log",
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        datasets=SETTINGS,
        methods=TITLES,
        code=code_of("figure_ranked_forecasts"),
    message:
        "Figure rank"
    script:
        "../scripts/figure_ranked_forecasts.py"


rule figure_prediction_examples:
    """What every method forecast for an example track (the paper's fig:prediction_example)."""
    input:
        EXAMPLE_FILES,
        floor_plans=[file for one in DATASETS.values() for file in one["floor_plan"]],
    output:
        csv=f"{EXHIBITS}/prediction_example.csv",
        pdf=f"{EXHIBITS}/prediction_example.pdf",
        png=report(
            f"{EXHIBITS}/prediction_example.png",
            caption="../report/prediction_example.rst",
            category="Forecasts",
            labels={"exhibit": "forecasts of all methods", "dataset": "all"},
        ),
    log:
        f"results/{RUN}/logs/figure_prediction_examples.log",
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        datasets=SETTINGS,
        methods=TITLES,
        code=code_of("figure_prediction_examples"),
    message:
        "Figure prediction_example"
    script:
        "../scripts/figure_prediction_examples.py"


WITH_MEMORY = [kind for kind in FOLLOWED if kind in TITLES]


rule figure_memory_maps:
    """What the maps with memory hold around a walker, and how each forecasts (not in the paper)."""
    input:
        EXAMPLE_FILES,
        maps=[f"results/{RUN}/{dataset}/maps/snippets.parquet" for dataset in DATASETS],
        floor_plans=[file for one in DATASETS.values() for file in one["floor_plan"]],
    output:
        csv=f"{EXHIBITS}/memory-maps.csv",
        pdf=f"{EXHIBITS}/memory-maps.pdf",
        png=report(
            f"{EXHIBITS}/memory-maps.png",
            caption="../report/memory-maps.rst",
            category="Maps",
            labels={"exhibit": "maps with memory", "dataset": "all"},
        ),
    log:
        f"results/{RUN}/logs/figure_memory_maps.log",
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        datasets=SETTINGS,
        methods={name: TITLES[name] for name in WITH_MEMORY},
        code=code_of("figure_memory_maps"),
    message:
        "Figure memory-maps"
    script:
        "../scripts/figure_memory_maps.py"


FORECAST_FIGURES = [
    rules.figure_ranked_forecasts.output,
    rules.figure_prediction_examples.output,
    rules.figure_memory_maps.output if len(WITH_MEMORY) == len(FOLLOWED) else [],
]
