# Errors of every forecast under both protocols, as paths and as distributions, and their summaries.
#
# INPUTS   clean test tracks, forecasts; maps for distributions, whose samples are drawn again and not stored
# OUTPUTS  results/{run}/{dataset}: errors/{method}.parquet, uncertainty/{method}.parquet, ttests.parquet, costs.json,
#          ladder/{scores,differences}.parquet; paper_figures/{run}/results.csv
# STEPS    score_method, measure_uncertainty; compare_methods, summarise_results; measure_costs, climb_ladder


rule score_method:
    """ADE and FDE at every horizon of each test track and seed, under both protocols."""
    input:
        tracks=tracks_of("test"),
        forecasts=LAYOUT.forecasts("{dataset}", "{method}"),
        floor_plan=lambda wildcards: DATASETS[wildcards.dataset].floor_plan,
    output:
        LAYOUT.errors("{dataset}", "{method}"),
    log:
        LAYOUT.log("score_method", "{dataset}", "{method}"),
    benchmark:
        LAYOUT.benchmark("score_method", "{dataset}", "{method}")
    group:
        "methods"
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        run=RUN.run,
        dataset=settings_of(*SCORE_KEYS),
        origin_m=lambda wildcards: DATASETS[wildcards.dataset].origin_m,
        recordings=names_of("test"),
        code=code_of("score_method"),
    message:
        "Score {wildcards.method} on {wildcards.dataset}"
    script:
        "../scripts/score_method.py"


if PLAN.read_anew:

    rule read_protocol:
        """Errors of the paper's methods at the longest horizon under every reading of the scoring rules."""
        input:
            tracks=tracks_of("test"),
            forecasts=[LAYOUT.forecasts("{dataset}", name) for name in PLAN.read_anew],
        output:
            [LAYOUT.readings("{dataset}", name) for name in PLAN.read_anew],
        log:
            LAYOUT.log("read_protocol", "{dataset}"),
        benchmark:
            LAYOUT.benchmark("read_protocol", "{dataset}")
        group:
            "exhibits"
        resources:
            mem_mb=1500,
            runtime=30,
        params:
            run=RUN.run,
            methods=PLAN.read_anew,
            dataset=settings_of(*SCORE_KEYS),
            recordings=names_of("test"),
            code=code_of("read_protocol"),
        message:
            "Readings of the scoring rules on {wildcards.dataset}"
        script:
            "../scripts/read_protocol.py"


rule measure_encounters:
    """How often forecasts run into where other people really were."""
    input:
        tracks=tracks_of_people("test"),
        forecasts=[LAYOUT.forecasts("{dataset}", name) for name in RUN.compare],
    output:
        [LAYOUT.encounters("{dataset}", name) for name in RUN.compare],
    log:
        LAYOUT.log("measure_encounters", "{dataset}"),
    benchmark:
        LAYOUT.benchmark("measure_encounters", "{dataset}")
    group:
        "exhibits"
    resources:
        mem_mb=2500,
        runtime=60,
    params:
        run=RUN.run,
        methods=list(RUN.compare),
        dataset=settings_of(*SCORE_KEYS),
        recordings=neighbours_of("test"),
        horizons=lambda wildcards: PLAN.horizons[wildcards.dataset],
        code=code_of("measure_encounters"),
    message:
        "Encounters on {wildcards.dataset}"
    script:
        "../scripts/measure_encounters.py"


rule measure_uncertainty:
    """Energy score, best of five, expected error and probability of having left, by track and seed."""
    input:
        tracks=tracks_of("test"),
        map=method_map,
        exits=method_exits,
        forecasts=LAYOUT.forecasts("{dataset}", "{method}"),
    output:
        LAYOUT.uncertainty("{dataset}", "{method}"),
    log:
        LAYOUT.log("measure_uncertainty", "{dataset}", "{method}"),
    benchmark:
        LAYOUT.benchmark("measure_uncertainty", "{dataset}", "{method}")
    wildcard_constraints:
        method="|".join(PLAN.measured) or NO_METHOD,
    group:
        "methods"
    resources:
        mem_mb=2000,
        runtime=60,
    params:
        run=RUN.run,
        method=method_of,
        samples=RUN.uncertainty.samples,
        drawn_again=lambda wildcards: wildcards.method
        not in PLAN.learned + PLAN.handed_in,
        dataset=settings_of(*FORECAST_KEYS),
        recordings=names_of("test"),
        seeds=lambda wildcards: SEEDS[wildcards.method],
        horizons=lambda wildcards: PLAN.horizons[wildcards.dataset],
        code=lambda wildcards: method_code("measure_uncertainty", wildcards.method),
    message:
        "Measure the distribution of {wildcards.method} on {wildcards.dataset}"
    script:
        "../scripts/measure_uncertainty.py"


rule compare_methods:
    """Paired one-sided t-tests between methods on the same tracks."""
    input:
        [LAYOUT.errors("{dataset}", method) for method in RUN.compare],
    output:
        LAYOUT.ttests("{dataset}"),
    log:
        LAYOUT.log("compare_methods", "{dataset}"),
    benchmark:
        LAYOUT.benchmark("compare_methods", "{dataset}")
    group:
        "exhibits"
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        run=RUN.run,
        methods=list(RUN.compare),
        dataset=settings_of("time_step_s", "horizon_s"),
        pairs=PLAN.tested_pairs,
        horizons=lambda wildcards: claim_horizons(
            DATASETS[wildcards.dataset], PLAN.horizons[wildcards.dataset]
        ),
        days=lambda wildcards: DATASETS[wildcards.dataset].days("test"),
        code=code_of("compare_methods"),
    message:
        "Compare the methods on {wildcards.dataset}"
    script:
        "../scripts/compare_methods.py"


rule summarise_results:
    """Every score of a run, in long form."""
    input:
        [
            LAYOUT.errors(dataset, method)
            for dataset in DATASETS
            for method in RUN.compare
        ],
    output:
        LAYOUT.scores,
    log:
        LAYOUT.log("summarise_results"),
    benchmark:
        LAYOUT.benchmark("summarise_results")
    group:
        "exhibits"
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        run=RUN.run,
        time_steps={name: dataset.time_step_s for name, dataset in DATASETS.items()},
        methods=list(RUN.compare),
        code=code_of("summarise_results"),
    message:
        "All scores of run {RUN.run}"
    script:
        "../scripts/summarise_results.py"


RUNGS = [method for method, _ in RUN.rungs]
COSTED = list(
    dict.fromkeys(part for name in RUNGS for part in RUN.averaged_parts(name))
)


rule measure_costs:
    """Time of a forecast by each rung, on one core, observing included."""
    input:
        tracks=tracks_of("test"),
        maps=lambda wildcards: sorted(
            {
                PLAN.map_of(wildcards.dataset, name)
                for name in COSTED
                if RUN.kind(name).has_map
            }
        ),
        exits=lambda wildcards: LAYOUT.map(wildcards.dataset, "exits"),
        weights=lambda wildcards: [
            PLAN.weights_of(wildcards.dataset, name)
            for name in COSTED
            if name in PLAN.learned
        ],
    output:
        LAYOUT.costs("{dataset}"),
    log:
        LAYOUT.log("measure_costs", "{dataset}"),
    benchmark:
        LAYOUT.benchmark("measure_costs", "{dataset}")
    threads: 1000  # capped to all there are, so it runs alone
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        run=RUN.run,
        methods=lambda wildcards: [
            PLAN.method(wildcards.dataset, name).plain() for name in COSTED
        ],
        averages={
            name: RUN.averaged_parts(name) for name in RUNGS if name in PLAN.averages
        },
        weights=lambda wildcards: {
            name: PLAN.weights_of(wildcards.dataset, name)
            for name in COSTED
            if name in PLAN.learned
        },
        dataset=settings_of(*SCORE_KEYS),
        code=method_code("measure_costs", *COSTED),
    message:
        "Costs of the ladder on {wildcards.dataset}"
    script:
        "../scripts/measure_costs.py"


rule climb_ladder:
    """Errors of every rung and paired differences, with their intervals over persons or days."""
    input:
        [LAYOUT.errors("{dataset}", method) for method in RUN.ladder_methods],
    output:
        scores=LAYOUT.ladder("{dataset}", "scores"),
        differences=LAYOUT.ladder("{dataset}", "differences"),
    log:
        LAYOUT.log("climb_ladder", "{dataset}"),
    benchmark:
        LAYOUT.benchmark("climb_ladder", "{dataset}")
    group:
        "exhibits"
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        run=RUN.run,
        methods=RUN.ladder_methods,
        ladder=as_plain(RUN.ladder),
        horizons=lambda wildcards: PLAN.ladder_horizons[wildcards.dataset],
        dataset=settings_of("time_step_s", "horizon_s"),
        days=lambda wildcards: DATASETS[wildcards.dataset].days("test"),
        code=code_of("climb_ladder"),
    message:
        "Ladder of {wildcards.dataset}"
    script:
        "../scripts/climb_ladder.py"
