# Exhibits about the trainings of the learned baselines (not in the paper).
#
# INPUTS   results/{run}/{dataset}/models/{method}.json
# OUTPUTS  paper_figures/{run}/tab_models.{csv,tex,md,html}, learning-curves.{pdf,png,csv}
# STEPS    table_models, figure_learning_curves; MODEL_TABLES and MODEL_FIGURES collect them
TRAININGS = expand(
    f"results/{RUN}/{{dataset}}/models/{{method}}.json",
    dataset=DATASETS,
    method=LEARNED,
)


rule table_models:
    """Size, data, epochs and validation error of every trained network."""
    input:
        TRAININGS,
    output:
        **table_files("tab_models"),
    log:
        f"results/{RUN}/logs/table_models.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        datasets=SETTINGS,
        methods=titles_of(LEARNED),
        code=code_of("table_models"),
    message:
        "Table of networks"
    script:
        "../scripts/table_models.py"


rule figure_learning_curves:
    """Validation error and training loss of every network, epoch by epoch."""
    input:
        TRAININGS,
    output:
        csv=f"{EXHIBITS}/learning-curves.csv",
        pdf=f"{EXHIBITS}/learning-curves.pdf",
        png=report(
            f"{EXHIBITS}/learning-curves.png",
            caption="../report/learning-curves.rst",
            category="Studies",
            labels={"exhibit": "learning curves", "dataset": "all"},
        ),
    log:
        f"results/{RUN}/logs/figure_learning_curves.log",
    resources:
        mem_mb=1000,
        runtime=10,
    params:
        datasets=SETTINGS,
        methods=titles_of(LEARNED),
        code=code_of("figure_learning_curves"),
    message:
        "Figure learning-curves"
    script:
        "../scripts/figure_learning_curves.py"


MODEL_TABLES = rules.table_models.output if LEARNED else []
MODEL_FIGURES = rules.figure_learning_curves.output if LEARNED else []
