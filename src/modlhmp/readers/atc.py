"""The ATC shopping centre's two forms: the owner's raw days, and 1 Hz files in metres.

D. Brscic, T. Kanda, T. Ikeda, T. Miyashita, Person tracking in large public spaces using 3-D range sensors,
IEEE Trans. Human-Machine Systems 43(6):522-534, 2013.
"""

# time [s], id, x [mm], y [mm], z [mm], speed [mm/s], angle of motion [rad], facing angle [rad]
RAW_LAYOUT = {
    "columns": {"t": 0, "track_id": 1, "x": 2, "y": 3, "speed": 5, "heading": 6},
    "width": 8,
    "units": {"length": "mm"},
}
# time [s], id, x [m], y [m], speed [m/s], angle of motion [rad]
ONE_HZ_LAYOUT = {"columns": {"t": 0, "track_id": 1, "x": 2, "y": 3, "speed": 4, "heading": 5}, "width": 6}
