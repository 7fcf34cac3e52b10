"""The table across sites, in its forms, and every site's own rows as CSV (`study.sites`)."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from modlhmp.storage import write_text
from modlhmp.study.csv_cells import csv_text
from modlhmp.study.exhibits.table_forms import write_table
from modlhmp.study.sites import gather

NOTE = (
    "Every site counts the same: `mean` is that of the sites' means, ± their SD between sites, in m; `scored` is n of "
    "eligible forecasts, over all sites. `less {reference}` is the mean over sites of the paired difference within "
    "each, on the tracks that both scored, with its 95 % interval and p from Student's t with one degree of freedom "
    "less than sites; p is one-sided (smaller error than {reference}; the opposite side stands in the CSV) and "
    "Holm-corrected over a protocol's rows. (k sites): of so many only, the others are named below. `†`: at so many "
    "sites one side could not forecast some tracks. –: what there is too little for. by_site.csv has every site."
)


def write_sites(found: Mapping[str, pd.DataFrame | str], reference: str, folder: str, demo: bool) -> None:
    """Write `sites.csv`, `.md`, `.html` and `.tex`, and `by_site.csv`; arguments as of `sites.gather`."""
    table, by_site = gather(found, reference)
    shown = pd.DataFrame([_cells(row, reference) for row in table.itertuples()])
    failed = pd.DataFrame([(s, why) for s, why in found.items() if isinstance(why, str)], columns=["site", "why"])
    others = [("Sites without results", failed)] if len(failed) else []
    for title, name in (("Not in the means", "left_out"), ("In the means, not in the differences", "not_paired")):
        out = table[table[name] != ""].drop_duplicates(["protocol", "horizon_s", "method"])
        listed = out[["protocol", "horizon_s", "method", name]]
        others += [(title, listed.rename(columns={"horizon_s": "horizon [s]", name: "sites"}))] if len(out) else []
    heading = f"{len(found) - len(failed)} of {len(found)} sites"
    write_table(shown, f"{folder}/sites", heading, demo, NOTE.format(reference=reference), others)
    write_text(f"{folder}/sites.csv", csv_text(table, float_format="%.6g"))  # numbers, not the cells that are shown
    write_text(f"{folder}/by_site.csv", csv_text(by_site, float_format="%.6g"))


def _cells(row, reference):
    """A line as it is shown."""
    known = np.isfinite(row.mean_m)
    difference = f"{row.difference_m:+.3f}" if np.isfinite(row.difference_m) else "–"
    if np.isfinite(row.ci_low_m):
        difference += f" ({row.ci_low_m:+.3f} to {row.ci_high_m:+.3f})"
    if 0 < row.sites_paired < row.sites:
        difference += f" ({row.sites_paired} site{'s' if row.sites_paired > 1 else ''})"
    if row.sites_unknown:
        difference += f" † {row.sites_unknown}"
    return {
        "protocol": row.protocol, "horizon [s]": f"{row.horizon_s:g}", "metric": row.metric.upper(),
        "method": row.method, "sites": row.sites,
        "mean [m]": f"{row.mean_m:.3f}" + (f" ± {row.sd_m:.3f}" if np.isfinite(row.sd_m) else "") if known else "–",
        "scored": f"{row.n:.6g} / {row.eligible:.6g}" if known else "–",
        f"less {reference} [m]": difference,
        "p Holm": f"{row.p_holm:.2g}" if np.isfinite(row.p_holm) else "–",
    }  # fmt: skip
