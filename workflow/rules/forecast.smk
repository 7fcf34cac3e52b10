# Forecasts of every usable test track, to the longest horizon.
#
# INPUTS   a clean test recording; the map of the method, if it has one
# OUTPUTS  results/{run}/{dataset}/forecasts/{method}/{recording}.parquet
# STEPS    forecast_recording; average_forecasts for methods that are the mean of others


rule forecast_recording:
    """k futures of each usable track of a test recording, for every seed."""
    input:
        tracks=f"results/{RUN}/{{dataset}}/tracks/{{recording}}.parquet",
        map=method_map,
        exits=method_exits,
    output:
        f"results/{RUN}/{{dataset}}/forecasts/{{method}}/{{recording}}.parquet",
    log:
        f"results/{RUN}/logs/forecast_recording/{{dataset}}/{{method}}/{{recording}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/forecast_recording/{{dataset}}/{{method}}/{{recording}}.tsv"
    wildcard_constraints:
        method="|".join(name for name in METHODS if name not in LEARNED + AVERAGES)
        or NO_METHOD,
    resources:
        mem_mb=1500,
        runtime=60,
    params:
        method=lambda wildcards: method_of(wildcards.dataset, wildcards.method),
        dataset=lambda wildcards: settings_of(wildcards.dataset, FORECAST_KEYS),
        seeds=config["seeds"],
        code=code_of("forecast_recording"),
    message:
        "Forecast {wildcards.dataset} {wildcards.recording} with {wildcards.method}"
    script:
        "../scripts/forecast_recording.py"


rule average_forecasts:
    """The mean of other methods' paths, as a method of its own."""
    input:
        lambda wildcards: [
            f"results/{RUN}/{wildcards.dataset}/forecasts/{name}/{wildcards.recording}.parquet"
            for name in members(config, wildcards.method)
        ],
    output:
        f"results/{RUN}/{{dataset}}/forecasts/{{method}}/{{recording}}.parquet",
    log:
        f"results/{RUN}/logs/average_forecasts/{{dataset}}/{{method}}/{{recording}}.log",
    wildcard_constraints:
        method="|".join(AVERAGES) or NO_METHOD,
    resources:
        mem_mb=1500,
        runtime=10,
    params:
        method=lambda wildcards: METHODS[wildcards.method],
        code=code_of("average_forecasts"),
    message:
        "Average forecasts of {wildcards.dataset} {wildcards.recording} as {wildcards.method}"
    script:
        "../scripts/average_forecasts.py"
