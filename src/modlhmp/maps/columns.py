"""What the columns of every map's tables are: their units and meanings, for documents and for `modlhmp map info`."""

import pyarrow as pa

CELL = "number of the cell: it reaches from this many times `cell` to one more"
HEADING_BIN = "bin of 45 degrees around 0 (east), 1 (north-east) ... 7; 8: hardly moving"
CLIFF = {
    "location": ("", "number of the location, from 0; its components stand together"),
    "x": ("m", "position of the location"),
    "y": ("m", "position of the location"),
    "weight": ("", "of the component in its mixture; they sum to 1"),
    "mean_heading": ("rad", "mean heading, from -pi to pi, from x towards y"),
    "mean_speed": ("m/s", "mean speed"),
    "var_heading": ("rad2", "variance of the heading, unwrapped"),
    "cov_heading_speed": ("rad m/s", "covariance"),
    "var_speed": ("m2/s2", "variance of the speed"),
    "count": ("", "observations at the location; 0: unknown"),
    "p": ("", "motion intensity: its count by the largest, or the share of time with motion"),
    "q": ("", "observation ratio: 1, the sensors see everything, always"),
}
TABLES: dict[str, dict[str, tuple[str, str]]] = {
    "CLiFF-map, whole day or hour: a row a component": CLIFF,
    "Smoothed CLiFF-map and neural velocity map, whole day or hour: a row a component": {
        **CLIFF,
        "background": ("", "of the location: weight of what is known of people anywhere, the mixture has the rest"),
    },
    "STeF-map, whole day: a row a cell and orientation": {
        "x": ("m", "centre of the cell"),
        "y": ("m", "centre of the cell"),
        "orientation": ("", "number i of the orientation i * 2 pi / `orientations`, from 0"),
        "mean": ("", "mean share of the orientation in the busiest one's count"),
        "amplitudes": ("", "list: of each periodic part, half of its swing, strongest first"),
        "phases": ("rad", "list: phase of each"),
        "periods": ("s", "list: period of each; time counts from the first local midnight of the training data"),
    },
    "STeF-map, hour: a row a cell": {
        "x": ("m", "centre of the cell"),
        "y": ("m", "centre of the cell"),
        "probabilities": ("", "list: of each orientation in the middle of the hour; they sum to 1, or are all 0"),
    },
    "Episode map: a row a person and time step": {
        "person": ("", "number of the person, from 0"),
        "t": ("s", "unix time"),
        "x": ("m", "position"),
        "y": ("m", "position"),
    },
    "Snippet flow map: a row a snippet": {
        "i": ("", CELL + ", in x"),
        "j": ("", CELL + ", in y"),
        "bin": ("", HEADING_BIN),
        "x": ("m", "position where it starts"),
        "y": ("m", "position where it starts"),
        "minute": ("min", "unix time of its start"),
        "stands_for": ("", "how many snippets of the training data it stands for"),
        "steps": ("", "steps walked, up to one more than it holds; no more than it holds: the person left"),
        "path": ("m", "list of x, y relative to the start: `past` steps before it, the start, then what followed"),
    },
    "Ways out: a row a cell and heading bin": {
        "i": ("", CELL + ", in x"),
        "j": ("", CELL + ", in y"),
        "bin": ("", HEADING_BIN),
        "left": ("", "people who left within the next time step"),
        "rows": ("", "rows of tracks seen there"),
    },
}
METADATA = {  # of a table's schema, as text
    "resolution": "distance of neighbouring locations, or size of a STeF-map's cell [m]",
    "radius": "a location took the observations within this distance [m]",
    "busiest": "how many people walk within the radius of the busiest location, on average",
    "orientations": "number of orientations",
    "cell": "size of a cell [m]",
    "step": "time step [s]",
    "past": "steps before the start of a snippet",
    "imported": "of a map from elsewhere, as JSON: file, its SHA-256, form, what was repaired and how often",
    "modlhmp": "as JSON: `kind`, `site` (time zone, time step, ...), `hour` of an hour's map, and where it came from",
}


def described(table: pa.Table) -> dict[str, tuple[str, str]]:
    """{column: (unit, meaning)} of a map's table; {} of one of another package's kind."""
    return next((columns for columns in TABLES.values() if list(columns) == table.column_names), {})
