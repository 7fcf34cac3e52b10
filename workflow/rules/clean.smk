# From raw recordings to clean tracks.
#
# INPUTS   a raw recording
# OUTPUTS  results/{run}/{dataset}/tracks/{recording}.parquet and its account of every row and track
# STEPS    clean_recording


rule clean_recording:
    """Read a recording, drop bad rows and tracks under their names, bring it to the time step."""
    input:
        raw=lambda wildcards: recording(wildcards)["stored"],
    output:
        tracks=f"results/{RUN}/{{dataset}}/tracks/{{recording}}.parquet",
        account=f"results/{RUN}/{{dataset}}/tracks/{{recording}}.account.json",
    log:
        f"results/{RUN}/logs/clean_recording/{{dataset}}/{{recording}}.log",
    benchmark:
        f"results/{RUN}/benchmarks/clean_recording/{{dataset}}/{{recording}}.tsv"
    resources:
        mem_mb=1000,
        runtime=30,
    params:
        dataset=lambda wildcards: settings_of(wildcards.dataset, CLEANING_KEYS),
        recording=lambda wildcards: {
            key: recording(wildcards)[key]
            for key in ("file", "member", "day", "start", "split", "part")
        },
        sources=lambda wildcards: DATASETS[wildcards.dataset]["sources"],
        sums="resources/SHA256SUMS",
        code=code_of("clean_recording"),
    message:
        "Clean {wildcards.dataset} {wildcards.recording}"
    script:
        "../scripts/clean_recording.py"
