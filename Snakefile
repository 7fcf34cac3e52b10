# Front door: `snakemake --cores 2` at the root runs workflow/Snakefile. An included file cannot set the default
# target, hence the second line.
include: "workflow/Snakefile"


workflow.default_target = "all"
