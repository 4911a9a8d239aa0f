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
}
