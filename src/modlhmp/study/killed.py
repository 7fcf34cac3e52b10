"""What to say of jobs that were killed: Snakemake names the signal, in the middle of a command, and no reason."""

import re
from collections.abc import Iterable
from pathlib import Path

# What Snakemake says of such a command, and by bash's exit status where that outlives it; then come the rule's lines.
_KILLED = re.compile(r"died with <Signals\.SIGKILL: 9>|non-zero exit status (?:137|-9)\b")
_ERROR = re.compile(r"^Error in (?:group job )?rule (\w+)", re.MULTILINE)


def killed_jobs(logs: str | Path | Iterable[str | Path]) -> list[str]:
    """A message for each rule of which a job was killed, from the log of a run, or its logs; none that says nothing."""
    files = [logs] if isinstance(logs, str | Path) else list(logs)
    text = "\n".join(Path(file).read_text(errors="replace") for file in files if Path(file).is_file())
    rules = [found[1] for one in _KILLED.finditer(text) if (found := _ERROR.search(text, one.end()))]
    return [_told(rule, text) for rule in dict.fromkeys(rules)]


def _told(rule: str, text: str) -> str:
    """What to say of a rule's job, with the memory that the rule was measured to need."""
    job = rf"^(?:local)?rule {rule}:\n(?:(?! *$).*\n)*?    resources: .*\bmem_mb=(\d+)"
    stated = re.search(job, text, re.MULTILINE)
    need = f"; it needs up to {stated[1]} MB (`mem_mb` of the rule)" if stated else ""
    return (
        f"A job of rule {rule} was killed (signal 9), as the system does where memory runs out{need}. Run fewer jobs "
        "at once, --cores 1 or --resources mem_mb=<free memory in MB>; what is finished is kept."
    )
