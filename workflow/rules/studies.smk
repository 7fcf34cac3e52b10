# Studies: a method with one parameter of its roll-out varied, or with less training data; time, memory and map size.
#
# INPUTS   clean tracks, the studied method's map, those whose likelihood is measured
# OUTPUTS  results/{run}/{dataset}/studies/{parameter}/{value}.parquet (errors only);
#          results/{run}/{dataset}/studies/training/{method}/{share}.parquet; results/{run}/{dataset}/runtime.json;
#          results/{run}/{dataset}/occupied/{bins,scores,film}.parquet;
#          results/{run}/{dataset}/likelihood/{scores,pairs,given,given_pairs}.parquet
# STEPS    study_parameter, study_training, study_occupied, measure_likelihood, measure_given; measure_runtime, for the target `runtime`, since timings count
#          only while nothing else runs

# Methods that are asked for two steps, and those whose forecasts are there: networks, means of others, from outside.
READ = PLAN.learned + PLAN.averages + PLAN.handed_in
GIVEN = {
    "made": [name for name in PLAN.given if name not in READ],
    "read": [name for name in PLAN.given if name in READ],
}


rule study_parameter:
    """Errors of one method on a fixed sample of the test tracks, for every value of one parameter."""
    input:
        tracks=tracks_of("test"),
        map=lambda wildcards: PLAN.map_of(wildcards.dataset, RUN.studies.method),
        exits=lambda wildcards: PLAN.exits_of(wildcards.dataset, RUN.studies.method),
    output:
        directory(LAYOUT.study("{dataset}", "{parameter}")),
    log:
        LAYOUT.log("study_parameter", "{dataset}", "{parameter}"),
    benchmark:
        LAYOUT.benchmark("study_parameter", "{dataset}", "{parameter}")
    wildcard_constraints:
        parameter="beta|sampling_radius_m",
    group:
        "studies"
    resources:
        mem_mb=1500,
        runtime=60,
    params:
        run=RUN.run,
        method=lambda wildcards: PLAN.method(
            wildcards.dataset, RUN.studies.method
        ).plain(),
        values=lambda wildcards: list(getattr(RUN.studies, wildcards.parameter)),
        max_tracks=RUN.studies.max_tracks,
        dataset=settings_of(*SCORE_KEYS),
        recordings=names_of("test"),
        seeds=SEEDS.get(RUN.studies.method, list(RUN.seeds)),
        code=method_code("study_parameter", RUN.studies.method),
    message:
        "Study {wildcards.parameter} on {wildcards.dataset}"
    script:
        "../scripts/study_parameter.py"


rule study_training:
    """Errors of maps that are built from a share of the training tracks."""
    input:
        tracks=tracks_of("test"),
        training=tracks_of("train"),
    output:
        directory(LAYOUT.study("{dataset}", "training")),
    log:
        LAYOUT.log("study_training", "{dataset}"),
    benchmark:
        LAYOUT.benchmark("study_training", "{dataset}")
    group:
        "studies"
    resources:
        mem_mb=2000,
        runtime=60,
    params:
        run=RUN.run,
        shares=list(RUN.studies.training.shares),
        methods=lambda wildcards: [
            PLAN.method(wildcards.dataset, name).plain() for name in PLAN.from_less
        ],
        max_tracks=RUN.studies.max_tracks,
        buildings={
            kind: as_plain(RUN.building(find(kind)))
            for kind in sorted({"exits", *(RUN.kind(n).name for n in PLAN.from_less)})
        },
        dataset=settings_of(*SCORE_KEYS),
        recordings=names_of("test"),
        seeds={name: SEEDS[name] for name in PLAN.from_less},
        code=method_code("study_training", *PLAN.from_less),
    message:
        "Study the amount of training data on {wildcards.dataset}"
    script:
        "../scripts/study_training.py"


rule study_occupied:
    """How often cells were occupied that had been given some probability, everyone forecast without contemporaries."""
    input:
        tracks=lambda wildcards: PLAN.tracks(wildcards.dataset, "train")
        + PLAN.tracks(wildcards.dataset, "test"),
    output:
        bins=LAYOUT.occupied("{dataset}", "bins"),
        scores=LAYOUT.occupied("{dataset}", "scores"),
        film=LAYOUT.occupied("{dataset}", "film"),
    log:
        LAYOUT.log("study_occupied", "{dataset}"),
    benchmark:
        LAYOUT.benchmark("study_occupied", "{dataset}")
    group:
        "studies"
    resources:
        mem_mb=4000,
        runtime=60,
    params:
        methods=lambda wildcards: [
            PLAN.method(wildcards.dataset, name).plain()
            for name in RUN.studies.occupied.methods
        ],
        buildings={
            kind: as_plain(RUN.building(find(kind)))
            for kind in sorted(
                {"exits", *(RUN.kind(n).name for n in RUN.studies.occupied.methods)}
            )
        },
        every_s=RUN.studies.occupied.every_s,
        horizons=lambda wildcards: PLAN.horizons[wildcards.dataset],
        dataset=settings_of("forecast_every_s", *SITE_KEYS),
        seed=RUN.seeds[0],
        code=method_code("study_occupied", *RUN.studies.occupied.methods),
    message:
        "Study which cells of {wildcards.dataset} will be occupied"
    script:
        "../scripts/study_occupied.py"


rule measure_likelihood:
    """How likely maps make the velocities of test persons, by place and time only."""
    input:
        training=tracks_of("train"),
        tracks=tracks_of("test"),
        maps=lambda wildcards: [
            PLAN.map_of(wildcards.dataset, name) for name in PLAN.mapped
        ],
    output:
        scores=LAYOUT.likelihood("{dataset}", "scores"),
        pairs=LAYOUT.likelihood("{dataset}", "pairs"),
    log:
        LAYOUT.log("measure_likelihood", "{dataset}"),
    benchmark:
        LAYOUT.benchmark("measure_likelihood", "{dataset}")
    group:
        "studies"
    resources:
        mem_mb=3000,
        runtime=60,
    params:
        methods=PLAN.mapped,
        kinds=[RUN.kind(name).name for name in PLAN.mapped],
        buildings=[
            None if RUN.published(name) else as_plain(RUN.building(RUN.kind(name)))
            for name in PLAN.mapped
        ],
        dataset=settings_of(*SITE_KEYS),
        clock=lambda wildcards: DATASETS[wildcards.dataset].clock != "unknown",
        days=lambda wildcards: DATASETS[wildcards.dataset].days("test"),
        recordings=names_of("test"),
        max_tracks=RUN.studies.max_tracks,
        code=method_code("measure_likelihood", *PLAN.mapped),
    message:
        "Measure the likelihood of maps on {wildcards.dataset}"
    script:
        "../scripts/measure_likelihood.py"


rule measure_given:
    """How likely methods make test persons' next velocities, given the last ones."""
    input:
        tracks=tracks_of("test"),
        maps=lambda wildcards: flat(
            [PLAN.map_of(wildcards.dataset, name) for name in GIVEN["made"]]
        ),
        exits=lambda wildcards: flat(
            [PLAN.exits_of(wildcards.dataset, name) for name in GIVEN["made"]]
        ),
        forecasts=lambda wildcards: [
            LAYOUT.forecasts(wildcards.dataset, name) for name in GIVEN["read"]
        ],
    output:
        given=LAYOUT.likelihood("{dataset}", "given"),
        given_pairs=LAYOUT.likelihood("{dataset}", "given_pairs"),
    log:
        LAYOUT.log("measure_given", "{dataset}"),
    benchmark:
        LAYOUT.benchmark("measure_given", "{dataset}")
    group:
        "studies"
    resources:
        mem_mb=3000,
        runtime=60,
    params:
        run=RUN.run,
        made=lambda wildcards: {
            name: PLAN.method(wildcards.dataset, name).plain()
            for name in GIVEN["made"]
        },
        methods=PLAN.given,
        samples=RUN.uncertainty.samples,
        dataset=settings_of(*FORECAST_KEYS),
        recordings=names_of("test"),
        days=lambda wildcards: DATASETS[wildcards.dataset].days("test"),
        seed=RUN.seeds[0],
        code=method_code("measure_given", *PLAN.given),
    message:
        "Measure the likelihood of next velocities on {wildcards.dataset}"
    script:
        "../scripts/measure_given.py"


rule measure_runtime:
    """Time per track, memory and map size of the studied method, in a separate process."""
    input:
        tracks=tracks_of("test"),
        map=lambda wildcards: PLAN.map_of(wildcards.dataset, RUN.studies.method),
        exits=lambda wildcards: PLAN.exits_of(wildcards.dataset, RUN.studies.method),
    output:
        LAYOUT.runtime("{dataset}"),
    log:
        LAYOUT.log("measure_runtime", "{dataset}"),
    benchmark:
        LAYOUT.benchmark("measure_runtime", "{dataset}")
    threads: 1000  # capped to all there are, so it runs alone
    resources:
        mem_mb=1500,
        runtime=15,
    params:
        run=RUN.run,
        method=lambda wildcards: PLAN.method(
            wildcards.dataset, RUN.studies.method
        ).plain(),
        dataset=settings_of("name", *SCORE_KEYS),
        recordings=names_of("test"),
        max_tracks=2000,
        code=method_code("measure_runtime", RUN.studies.method),
    message:
        "Measure the runtime on {wildcards.dataset}"
    script:
        "../scripts/measure_runtime.py"
