//! Exports as other people's tools read them.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, missing_docs)]

use kingpin_tests::support::{kingpin, peer};
use std::process::Command;

#[path = "exports/bridge.rs"]
mod bridge;

const READ: &str = r#"
import csv, math, struct, sys
from asammdf import MDF
folder = sys.argv[1]
rows = list(csv.reader(open(folder + "/log.csv")))
names, units, rows = rows[0], None, rows[1:]
mdf = MDF(folder + "/log.mf4")
columns = {name: i for i, name in enumerate(names)}
bits = lambda x: struct.pack("<d", x)
groups = {group.channel_group.acq_name for group in mdf.groups}
assert "vehicle_state" in groups and "rig_measurement" in groups, groups
seen = 0
for index, group in enumerate(mdf.groups):
    for channel in range(1, len(group.channels)):
        signal = mdf.get(group=index, index=channel)
        column = columns.pop(signal.name)
        cells = [(row[1], row[column]) for row in rows if row[column] != ""]
        assert len(cells) == len(signal.samples), signal.name
        for (time, cell), t, value in zip(cells, signal.timestamps, signal.samples):
            assert float(time) == t, (signal.name, time, t)
            if signal.samples.dtype.kind == "u":
                assert int(cell) == int(value), (signal.name, cell, value)
            else:
                same = bits(float(cell)) == bits(float(value)) or (math.isnan(float(cell)) and math.isnan(value))
                assert same, (signal.name, cell, value)
        assert signal.comment, signal.name
        seen += 1
left = [c for c in columns if c not in ("tick", "time_s")]
assert not left, left
assert mdf.get("vehicle_state.acceleration_m_s2.y").unit == "m/s²"
assert mdf.get("rig_measurement.steering_wheel_torque_n_m").unit == "N·m"
assert "Hand-wheel torque" in mdf.get("rig_measurement.steering_wheel_torque_n_m").comment
assert mdf.masters_db and mdf.version == "4.10", mdf.version
content, path, _ = mdf.extract_attachment(index=1)
assert "configuration" in str(path) and len(content) > 1000, (path, len(content))
print("channels", seen)
"#;

/// Every cell of the Parquet file against the CSV, to the bit; what pandas and pyarrow say of units and attachments.
const READ_PARQUET: &str = r#"
import csv, json, math, struct, sys
import pandas, pyarrow.parquet
folder = sys.argv[1]
rows = list(csv.reader(open(folder + "/log.csv")))
names, rows = rows[0], rows[1:]
frame = pandas.read_parquet(folder + "/log.parquet")
assert list(frame.columns) == names, set(frame.columns) ^ set(names)
assert len(frame) == len(rows)
bits = lambda x: struct.pack("<d", x)
table = pyarrow.parquet.read_table(folder + "/log.parquet")
for i, name in enumerate(names):
    unsigned = str(table.schema.field(name).type) == "uint64"
    for row, value in zip(rows, table.column(name).to_pylist()):
        cell = row[i]
        if cell == "":
            assert value is None, (name, value)
        elif unsigned:
            assert int(cell) == value, (name, cell, value)
        else:
            same = bits(float(cell)) == bits(value) or (math.isnan(float(cell)) and math.isnan(value))
            assert same, (name, cell, value)
units, comments = frame.attrs["units"], frame.attrs["comments"]
assert units["vehicle_state.acceleration_m_s2.y"] == "m/s²" and units["rig_status.state"] == ""
assert all(comments[name] for name in names), [name for name in names if not comments[name]]
assert "20th" in frame.attrs["decimation"], frame.attrs
metadata = table.schema.metadata
configuration = json.loads(metadata[b"kingpin.configuration"])
assert configuration["scenario"]["name"] == "slalom_120"
assert json.loads(metadata[b"kingpin.columns"])["rig_measurement.steering_wheel_torque_n_m"]["unit"] == "N·m"
assert any(key.startswith(b"kingpin.source/") for key in metadata)
mean = pandas.read_parquet(folder + "/mean.parquet")
full = pandas.read_parquet(folder + "/full.parquet")
assert list(mean.columns) == list(full.columns)[:2] + [n for n in full.columns[2:]]
assert all(n.startswith("vehicle_state.position_m.") or "force_n" in n for n in mean.columns[2:]), list(mean.columns)
assert "mean over 20" in mean.attrs["decimation"]
name = "vehicle_state.position_m.x"
blocks = full.groupby(full["tick"] // 20)
expected = blocks[name].mean()
assert (abs(mean[name].to_numpy() - expected.to_numpy()) < 1e-9).all()
assert abs(mean[name].to_numpy() - blocks[name].first().to_numpy()).max() > 1e-3
print("columns", len(names))
"#;

#[test]
fn asammdf_reads_every_channel_with_its_bits_unit_and_comment() {
    let Some(python) = peer("asammdf") else { return };
    let folder = tempfile::tempdir().unwrap();
    let call = |arguments: &[&str]| {
        let done = Command::new(kingpin())
            .args(arguments)
            .current_dir(folder.path())
            .env("KINGPIN_RUNTIME_DIR", folder.path().join("runtime"))
            .output()
            .unwrap();
        assert!(done.status.success(), "{arguments:?}: {}", String::from_utf8_lossy(&done.stderr));
    };
    let name = format!("exports-{}", std::process::id());
    call(&[
        "run",
        "slalom_120",
        "--lockstep",
        "--no-report",
        "--duration",
        "2",
        "--set",
        "warm_up_s=0.5",
        "--out",
        "run",
        "--name",
        &name,
    ]);
    for format in ["csv", "mf4"] {
        call(&["export", "run", "--format", format, "--every", "20"]);
    }
    let done = Command::new(python).args(["-c", READ]).arg(folder.path().join("run")).output().unwrap();
    let said = String::from_utf8_lossy(&done.stdout);
    assert!(done.status.success(), "{said}{}", String::from_utf8_lossy(&done.stderr));
    let channels: u32 = said.trim().rsplit(' ').next().unwrap().parse().unwrap();
    assert!(channels > 150, "{said}");

    // Parquet, as it is and by mean, some signals by pattern.
    let Some(python) = peer("pandas, pyarrow") else { return };
    call(&["export", "run", "--format", "parquet", "--every", "20"]);
    let some = ["--select", "vehicle_state.position_m,*tie_rod_force_n.left"];
    for (name, more) in
        [("run/full.parquet", &[][..]), ("run/mean.parquet", &["--every", "20", "--method", "mean"])]
    {
        call(&[&["export", "run", "--format", "parquet", "--output", name][..], &some, more].concat());
    }
    let done =
        Command::new(python).args(["-c", READ_PARQUET]).arg(folder.path().join("run")).output().unwrap();
    let said = String::from_utf8_lossy(&done.stdout);
    assert!(done.status.success(), "{said}{}", String::from_utf8_lossy(&done.stderr));

    // A log out of a log: the whole is the same log, a part has its signals.
    call(&["export", "run", "--format", "mcap"]);
    call(&["compare", "run", "run/export.mcap"]);
    call(&["export", "run/export.mcap", "--format", "mcap", "--output", "part.mcap", "--every", "20"]);
    let part = ["--select", "vehicle_state.roll_rad,rig_status"];
    call(&[&["export", "run", "--format", "mcap", "--output", "two.mcap"][..], &part].concat());
    let open = |name: &str| record::LogReader::open(&folder.path().join(name)).unwrap();
    let (whole, thin, two) = (open("run"), open("part.mcap"), open("two.mcap"));
    assert_eq!(whole.events.len(), thin.events.len());
    assert_eq!(whole.header.configuration, two.header.configuration);
    assert!(thin.header.decimation.unwrap().contains("20th"));
    let mut names: Vec<_> =
        two.regions().iter().map(|region| (region.name.as_str(), region.columns.len())).collect();
    let status = whole.region("rig_status").unwrap().columns.len();
    names.sort_unstable();
    assert_eq!(names, [("rig_status", status), ("vehicle_state", 2)]);
    let roll = |log: &record::LogReader| log.signal("vehicle_state.roll_rad").unwrap().value;
    let bits = |values: Vec<f64>| values.into_iter().map(f64::to_bits).collect::<Vec<_>>();
    assert_eq!(bits(roll(&two)), bits(roll(&whole)));
    // Not over the log itself.
    let refused = Command::new(kingpin())
        .args(["export", "run", "--format", "mcap", "--output", "run/log.mcap"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert_eq!(refused.status.code(), Some(2));
    assert_eq!(open("run").tick_range(), whole.tick_range());
}
