# Forecasts of every usable test track, to the longest horizon; networks are trained first.
#
# INPUTS   clean test recordings; the method's map or the network's weights, if there are any
# OUTPUTS  results/{run}/{dataset}/models/{method}.{safetensors,last.safetensors,json}, forecasts/{method}/{recording}.parquet
# STEPS    train_{method}; forecast_method, forecast_with_network; average_forecasts for the mean of others,
#          take_forecasts for those from outside
#
# One job forecasts all recordings of a dataset, since starting up takes longer than most recordings.

for method in PLAN.trained:

    rule:
        name:
            f"train_{method}"
        input:
            tracks=tracks_of_people("train"),
        output:
            weights=LAYOUT.weights("{dataset}", method),
            last=LAYOUT.weights("{dataset}", method, "last"),
            summary=LAYOUT.training("{dataset}", method),
        log:
            LAYOUT.log("train", "{dataset}", method),
        benchmark:
            LAYOUT.benchmark("train", "{dataset}", method)
        group:
            "trainings"
        threads: RUN.learned.threads
        resources:
            mem_mb=3000,
            runtime=24 * 60,
        params:
            run=RUN.run,
            method=lambda wildcards, method=method: PLAN.method(
                wildcards.dataset, method
            ).plain(),
            dataset=settings_of(*TRAINING_KEYS),
            days=neighbours_of("train"),
            code=method_code("train_network", method),
        message:
            f"Train {RUN.title(method)} on {{wildcards.dataset}}"
        script:
            "../scripts/train_network.py"


rule forecast_with_network:
    """Futures of each usable track of every test recording; everyone there on its day is seen as well."""
    input:
        tracks=tracks_of_people("test"),
        weights=lambda wildcards: PLAN.weights_of(wildcards.dataset, wildcards.method),
        summary=lambda wildcards: LAYOUT.training(
            wildcards.dataset, RUN.trained_as(wildcards.method)
        ),
    output:
        directory(LAYOUT.forecasts("{dataset}", "{method}")),
    log:
        LAYOUT.log("forecast_with_network", "{dataset}", "{method}"),
    benchmark:
        LAYOUT.benchmark("forecast_with_network", "{dataset}", "{method}")
    wildcard_constraints:
        method="|".join(PLAN.learned) or NO_METHOD,
    group:
        "methods"
    threads: RUN.learned.threads
    resources:
        mem_mb=3000,
        runtime=240,
    params:
        run=RUN.run,
        method=method_of,
        dataset=settings_of(*FORECAST_KEYS),
        recordings=neighbours_of("test"),
        seeds=lambda wildcards: SEEDS[wildcards.method],
        code=lambda wildcards: method_code("forecast_method", wildcards.method),
    message:
        "Forecast {wildcards.dataset} with {wildcards.method}"
    script:
        "../scripts/forecast_method.py"


rule forecast_method:
    """k futures of each usable track of every test recording, for every seed."""
    input:
        tracks=tracks_of("test"),
        map=method_map,
        exits=method_exits,
    output:
        directory(LAYOUT.forecasts("{dataset}", "{method}")),
    log:
        LAYOUT.log("forecast_method", "{dataset}", "{method}"),
    benchmark:
        LAYOUT.benchmark("forecast_method", "{dataset}", "{method}")
    wildcard_constraints:
        method="|".join(
            name
            for name in RUN.methods_run
            if name not in PLAN.learned + PLAN.averages + PLAN.handed_in
        )
        or NO_METHOD,
    group:
        "methods"
    resources:
        mem_mb=1500,
        runtime=30,
    params:
        run=RUN.run,
        method=method_of,
        dataset=settings_of(*FORECAST_KEYS),
        recordings=lambda wildcards: {
            one.name: [] for one in DATASETS[wildcards.dataset].of_split("test")
        },
        seeds=lambda wildcards: SEEDS[wildcards.method],
        code=lambda wildcards: method_code("forecast_method", wildcards.method),
    message:
        "Forecast {wildcards.dataset} with {wildcards.method}"
    script:
        "../scripts/forecast_method.py"


rule average_forecasts:
    """The mean of other methods' paths, as a method of its own."""
    input:
        lambda wildcards: [
            LAYOUT.forecasts(wildcards.dataset, name)
            for name in RUN.members(wildcards.method)
        ],
    output:
        directory(LAYOUT.forecasts("{dataset}", "{method}")),
    log:
        LAYOUT.log("average_forecasts", "{dataset}", "{method}"),
    benchmark:
        LAYOUT.benchmark("average_forecasts", "{dataset}", "{method}")
    wildcard_constraints:
        method="|".join(PLAN.averages) or NO_METHOD,
    group:
        "methods"
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        run=RUN.run,
        members=lambda wildcards: list(RUN.members(wildcards.method)),
        recordings=names_of("test"),
        code=code_of("average_forecasts"),
    message:
        "Average forecasts of {wildcards.dataset} as {wildcards.method}"
    script:
        "../scripts/average_forecasts.py"


rule take_forecasts:
    """Forecasts from outside, once they are known to be of this task's tracks, steps and horizon."""
    input:
        tracks=tracks_of("test"),
        files=lambda wildcards: PLAN.hand_in_files(
            wildcards.dataset, wildcards.method, DATA_ROOT
        ),
    output:
        directory(LAYOUT.forecasts("{dataset}", "{method}")),
    log:
        LAYOUT.log("take_forecasts", "{dataset}", "{method}"),
    benchmark:
        LAYOUT.benchmark("take_forecasts", "{dataset}", "{method}")
    wildcard_constraints:
        method="|".join(PLAN.handed_in) or NO_METHOD,
    group:
        "methods"
    resources:
        mem_mb=3000,
        runtime=30,
    params:
        run=RUN.run,
        method=method_of,
        dataset=settings_of(*FORECAST_KEYS),
        recordings=names_of("test"),
        code=code_of("take_forecasts"),
    message:
        "Take the forecasts of {wildcards.dataset} by {wildcards.method}"
    script:
        "../scripts/take_forecasts.py"
