# The exhibits, named after the paper's labels: one rule per record of modlhmp.study.exhibits.
#
# INPUTS   paper_figures/{run}/results.csv; results/{run}/{dataset}: what each record needs, and that its splits are checked
# OUTPUTS  paper_figures/{run}/<name>.{csv,tex,md,html} of tables, .{csv,pdf,png} of figures,
#          .html of the explorer; report.html
# STEPS    table_{name}, figure_{name}, page_{name}; tables, figures, studies and runtime collect them;
#          write_report puts all in their places

for exhibit in EXHIBITS:
    stem, names = LAYOUT.exhibit(exhibit.name), ["{label}"] * exhibit.per_dataset

    rule:
        name:
            exhibit.rule
        input:
            lambda wildcards, exhibit=exhibit: exhibit.needs(
                PLAN, shown_in(exhibit, wildcards)
            ),
        output:
            **{suffix: f"{stem}.{suffix}" for suffix in exhibit.suffixes[:-1]},
            **{
                exhibit.suffixes[-1]: report(
                    f"{stem}.{exhibit.suffixes[-1]}",
                    caption="../report/exhibit.rst",
                    category=exhibit.category,
                    labels={
                        "exhibit": exhibit.title,
                        "dataset": "{label}" if exhibit.per_dataset else "all",
                    },
                )
            },
        log:
            LAYOUT.log(exhibit.rule, *names),
        benchmark:
            LAYOUT.benchmark(exhibit.rule, *names)
        wildcard_constraints:
            label="|".join(one.label for one in DATASETS.values()),
        priority: int(exhibit.minutes <= 10)  # what can be looked at soon comes before what takes long
        group:
            "exhibits"
        resources:
            mem_mb=2000,
            runtime=exhibit.minutes,
        params:
            module=exhibit.module,
            function=exhibit.function,
            run=RUN.run,
            per_dataset=exhibit.per_dataset,
            datasets=lambda wildcards, exhibit=exhibit: [
                PLAN.settings_of(one.name) for one in shown_in(exhibit, wildcards)
            ],
            asks=lambda wildcards, exhibit=exhibit: exhibit.asks(
                PLAN, shown_in(exhibit, wildcards)
            ),
            caption=exhibit.caption_in(PLAN),
            code=code_of("draw_exhibit", *exhibit.code(PLAN)),
        message:
            f"{exhibit.form.capitalize()} {stem}".replace(
                "{label}", "{wildcards.label}"
            )
        script:
            "../scripts/draw_exhibit.py"


CHECKED = [LAYOUT.checks(name) for name in DATASETS]
TABLE_FILES = [LAYOUT.scores, *files_of(lambda one: one.category == "Tables")]
STUDY_FILES = files_of(lambda one: one.category == "Studies")
FIGURE_FILES = files_of(lambda one: one.category not in {"Tables", "Studies"})


rule tables:
    """Every table of the run."""
    input:
        CHECKED,
        TABLE_FILES,


rule figures:
    """Every figure of the run except those of the studies."""
    input:
        CHECKED,
        FIGURE_FILES,


rule studies:
    """Every study of the run: trainings, the ladder, one parameter varied, less training data, the runtime if measured."""
    input:
        STUDY_FILES,


REPORT_FILES = report_files(PLAN)


rule write_report:
    """The run as a paper: one page with every exhibit in its place."""
    input:
        REPORT_FILES,
    output:
        report(
            LAYOUT.report,
            caption="../report/exhibit.rst",
            category="Report",
            labels={"exhibit": "the report", "dataset": "all"},
        ),
    log:
        LAYOUT.log("write_report"),
    benchmark:
        LAYOUT.benchmark("write_report")
    group:
        "exhibits"
    resources:
        mem_mb=2000,
        runtime=15,
    params:
        run=RUN.run,
        datasets=[PLAN.settings_of(name) for name in DATASETS],
        about=about(PLAN),
        graph=lambda wildcards: rule_graph(workflow.rules, REPORT_FILES),
        rules={one.rule: one.form for one in EXHIBITS if one.made_in(PLAN)},
        look=assets_version(REPORT_ASSETS),
        caption="The run as a paper: question, data, method, results, claims and limits, every exhibit in its place, "
        "and which rule needs which. Opened from its own folder it leads on to the explorer and to every file.",
        code=code_of("write_report"),
    message:
        "Write the report of {LAYOUT.run}"
    script:
        "../scripts/write_report.py"


rule runtime:
    """The runtime study; nothing else should run on the machine meanwhile."""
    input:
        f"{LAYOUT.exhibit('runtime')}.png",
