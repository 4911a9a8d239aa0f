//! Hardpoint sets that nobody tuned the solver to, solved by the executable and checked from the written
//! files alone: left and right unlike, rod ahead of or behind the axle, skewed stabiliser axis, static toe
//! and camber, random motions with all six load components.
//!
//! The check shares no code with the solver: link lengths, points on lines and angles from the written pose;
//! force and moment balance of knuckle, arm and bar half from the written forces; virtual work by differences
//! of neighbouring rows. For each model the conditions are as many as the unknowns, so they fix the solution.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

use config::axle::{Axle, Bushing, Geometry};
use kingpin_tests::support::kingpin;
use std::collections::BTreeMap;
use std::process::Command;
use tempfile::TempDir;

type V = [f64; 3];

fn add(a: V, b: V) -> V {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}
fn sub(a: V, b: V) -> V {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}
fn times(k: f64, a: V) -> V {
    a.map(|x| k * x)
}
fn dot(a: V, b: V) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}
fn cross(a: V, b: V) -> V {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}
fn norm(a: V) -> f64 {
    dot(a, a).sqrt()
}
fn unit(a: V) -> V {
    times(1.0 / norm(a), a)
}
/// Turned by a unit quaternion, scalar first.
fn turn(q: [f64; 4], v: V) -> V {
    let e = [q[1], q[2], q[3]];
    let t = times(2.0, cross(e, v));
    add(add(v, times(q[0], t)), cross(e, t))
}
/// Turned about a unit axis [Rodrigues].
fn about(axis: V, angle: f64, v: V) -> V {
    let (s, c) = angle.sin_cos();
    add(add(times(c, v), times(s, cross(axis, v))), times((1.0 - c) * dot(axis, v), axis))
}

/// A fixed pseudo-random sequence in [-1, 1].
struct Random(u64);

impl Random {
    fn next(&mut self) -> f64 {
        self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (self.0 >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }
}

fn shipped(name: &str) -> Axle {
    let path = format!("{}/../schemas/suspensions/{name}.toml", env!("CARGO_MANIFEST_DIR"));
    toml::from_str(&std::fs::read_to_string(path).unwrap()).unwrap()
}

/// A perturbed axle: points by side and name, stabiliser, static angles.
struct Variant {
    kind: &'static str,
    spring_on: Option<&'static str>,
    sides: [BTreeMap<String, V>; 2],
    toe: [f64; 2],
    camber: [f64; 2],
    stiffness: Option<f64>,
}

impl Variant {
    /// A shipped axle with every point of each side moved by up to `by`, all its own.
    fn new(name: &str, by: f64, rod_ahead: bool, with_bar: bool, seed: u64) -> Self {
        let axle = shipped(name);
        let mut random = Random(seed);
        let mut sides = [0, 1].map(|k| {
            let mut points: BTreeMap<String, V> =
                axle.geometry.named_points(k).into_iter().map(|(n, p)| (n.to_owned(), p)).collect();
            if let (Some(bar), true) = (&axle.stabiliser, with_bar) {
                let half = &bar.sides()[k];
                points.insert("arb_bush".into(), half.arb_bush_m);
                points.insert("arb_arm_end".into(), half.arb_arm_end_m);
                points.insert("droplink_upper".into(), half.droplink_upper_m);
            }
            if rod_ahead {
                for end in ["tierod_inner", "tierod_outer"] {
                    let p = points.get_mut(end).unwrap();
                    p[0] = -p[0];
                }
            }
            points
        });
        for side in &mut sides {
            for (name, p) in side.iter_mut() {
                // A far more skewed bar than any other move.
                let by = if name == "arb_bush" { 3.0 * by } else { by };
                for x in p {
                    *x += by * random.next();
                }
            }
        }
        let mut pair = |limit: f64| [limit * random.next(), limit * random.next()];
        Self {
            kind: match axle.geometry {
                Geometry::DoubleWishbone(_) => "double_wishbone",
                Geometry::Strut(_) => "macpherson_strut",
                Geometry::FiveLink(_) => "five_link",
            },
            spring_on: match &axle.geometry {
                Geometry::FiveLink(five) => Some(five.spring_on.name()),
                _ => None,
            },
            sides,
            toe: pair(0.01),
            camber: pair(0.05),
            stiffness: with_bar.then(|| 1500.0 + 700.0 * random.next()),
        }
    }

    /// Unit wheel axis at design by the definitions of steer and camber.
    fn spin(&self, k: usize) -> V {
        let out = if k == 0 { 1.0 } else { -1.0 };
        let (steer, z) = (-out * self.toe[k], -out * self.camber[k].sin());
        let flat = (1.0 - z * z).sqrt();
        [-steer.sin() * flat, steer.cos() * flat, z]
    }

    fn json(&self) -> String {
        let side = |k: usize| {
            let mut points: serde_json::Map<String, serde_json::Value> =
                self.sides[k].iter().map(|(n, p)| (n.clone(), serde_json::json!(p))).collect();
            points.insert("spin_axis".into(), serde_json::json!(self.spin(k)));
            serde_json::Value::Object(points)
        };
        let mut root = serde_json::json!({
            "name": "variant", "type": self.kind, "frame": "body", "rack_full_m": 0.07, "loaded_radius": 0.3,
            "static_toe_in_rad": self.toe, "static_camber_rad": self.camber,
            "left": side(0), "right": side(1), "source": "a test",
        });
        if let Some(k) = self.stiffness {
            root["arb_stiffness_Nm_per_rad"] = serde_json::json!(k);
        }
        if let Some(link) = self.spring_on {
            root["spring_on"] = serde_json::json!(link);
        }
        root.to_string()
    }

    fn at(&self, k: usize, name: &str) -> V {
        self.sides[k][name]
    }
}

const H: f64 = 1e-5;
const LOADS: [&str; 6] = ["Fxk", "Fyk", "Fzk", "Mxk", "Myk", "Mzk"];

/// Random rows, each followed by its neighbours ±H in rack, left and right wheel height.
fn input(count: usize, rack: f64, travel: f64, seed: u64) -> String {
    let mut random = Random(seed);
    let mut text = "rack,zL,zR".to_owned();
    for side in ["L", "R"] {
        text.extend(LOADS.iter().map(|load| format!(",{load}_{side}")));
    }
    text.push('\n');
    for _ in 0..count {
        let at = [rack * random.next(), travel * random.next(), travel * random.next()];
        let loads: Vec<String> = (0..12)
            .map(|c| match c % 6 {
                2 => 4000.0 + 2500.0 * random.next(),
                0 | 1 => 3000.0 * random.next(),
                _ => 500.0 * random.next(),
            })
            .map(|x| x.to_string())
            .collect();
        for moved in
            [None, Some((0, H)), Some((0, -H)), Some((1, H)), Some((1, -H)), Some((2, H)), Some((2, -H))]
        {
            let mut here = at;
            if let Some((axis, by)) = moved {
                here[axis] += by;
            }
            text += &format!("{},{},{},{}\n", here[0], here[1], here[2], loads.join(","));
        }
    }
    text
}

/// The written rows by column.
struct Table {
    names: Vec<String>,
    rows: Vec<Vec<f64>>,
}

impl Table {
    fn get(&self, row: usize, name: &str) -> f64 {
        let at = self.names.iter().position(|n| n == name).unwrap_or_else(|| panic!("no column {name}"));
        self.rows[row][at]
    }

    fn vector(&self, row: usize, stem: &str, rest: &str) -> V {
        ["x", "y", "z"].map(|a| self.get(row, &format!("{stem}_{a}{rest}")))
    }

    fn load(&self, row: usize, kind: &str, frame: &str, s: &str) -> V {
        ["x", "y", "z"].map(|a| self.get(row, &format!("{kind}{a}{frame}_{s}")))
    }

    fn quaternion(&self, row: usize, s: &str) -> [f64; 4] {
        [0, 1, 2, 3].map(|c| self.get(row, &format!("q{c}_{s}")))
    }
}

fn solve(axle: &str, extension: &str, input: &str) -> Table {
    let folder = TempDir::new().unwrap();
    let file = |name: &str| folder.path().join(name).to_str().unwrap().to_owned();
    let (axle_file, in_file, out_file) =
        (file(&format!("axle.{extension}")), file("in.csv"), file("out.csv"));
    std::fs::write(&axle_file, axle).unwrap();
    std::fs::write(&in_file, input).unwrap();
    let ended = Command::new(kingpin())
        .args(["suspension", "solve", "--axle", &axle_file, "--input", &in_file, "--output", &out_file])
        .output()
        .unwrap();
    assert!(ended.status.success(), "{}\n{axle}", String::from_utf8_lossy(&ended.stderr));
    let text = std::fs::read_to_string(out_file).unwrap();
    let mut lines = text.lines();
    let names = lines.next().unwrap().split(',').map(str::to_owned).collect();
    let rows = lines.map(|l| l.split(',').map(|x| x.parse().unwrap()).collect()).collect();
    Table { names, rows }
}

/// Worst of each kind: lengths and points [m], angles [rad], balances relative to the largest load, virtual
/// work relative to the work of the rod or spring.
#[derive(Debug, Default)]
struct Worst {
    length: f64,
    angle: f64,
    balance: f64,
    work: f64,
}

fn worse(worst: &mut f64, off: f64) {
    assert!(off.is_finite());
    *worst = worst.max(off.abs());
}

/// Pose of one side's knuckle in a row, and where its design points are now.
struct Knuckle {
    centre: V,
    q: [f64; 4],
    design: V,
}

impl Knuckle {
    fn read(table: &Table, variant: &Variant, row: usize, k: usize) -> Self {
        let s = ["L", "R"][k];
        Self {
            centre: table.vector(row, "wc", &format!("_{s}")),
            q: table.quaternion(row, s),
            design: variant.at(k, "wheel_centre"),
        }
    }

    fn point(&self, design: V) -> V {
        add(self.centre, turn(self.q, sub(design, self.design)))
    }
}

/// Pose and angles of one side of one row.
fn check_pose(t: &Table, v: &Variant, row: usize, k: usize, legs: &[[&str; 2]], worst: &mut Worst) {
    let s = ["L", "R"][k];
    let out = if k == 0 { 1.0 } else { -1.0 };
    let knuckle = Knuckle::read(t, v, row, k);
    worse(&mut worst.length, knuckle.q.iter().map(|x| x * x).sum::<f64>() - 1.0);
    assert!(knuckle.q[0] >= 0.0);
    let height = t.get(row, if k == 0 { "zL" } else { "zR" });
    worse(&mut worst.length, knuckle.centre[2] - knuckle.design[2] - height);
    let rack = [0.0, t.get(row, "rack"), 0.0];
    let to = knuckle.point(v.at(k, "tierod_outer"));
    let inner = v.at(k, "tierod_inner");
    worse(&mut worst.length, norm(sub(to, add(inner, rack))) - norm(sub(v.at(k, "tierod_outer"), inner)));
    worse(&mut worst.length, norm(sub(to, t.vector(row, "to", &format!("_{s}")))));
    let patch = knuckle.point(v.at(k, "contact_patch"));
    worse(&mut worst.length, norm(sub(patch, t.vector(row, "cp", &format!("_{s}")))));
    for [a, b] in legs {
        let design = norm(sub(v.at(k, b), v.at(k, a)));
        worse(&mut worst.length, norm(sub(knuckle.point(v.at(k, b)), v.at(k, a))) - design);
    }
    let spin = turn(knuckle.q, v.spin(k));
    let steer = (-spin[0]).atan2(spin[1]);
    worse(&mut worst.angle, t.get(row, &format!("steer_{s}")) - steer);
    worse(&mut worst.angle, t.get(row, &format!("toe_{s}")) + out * steer);
    worse(&mut worst.angle, t.get(row, &format!("camber_{s}")) - (-out * spin[2]).asin());
    for (kind, what) in [("F", "F"), ("M", "M")] {
        let turned = turn(knuckle.q, t.load(row, kind, "k", s));
        let off = norm(sub(turned, t.load(row, what, "b", s))) / norm(turned).max(1.0);
        worse(&mut worst.balance, off);
    }
    let ends = match v.kind {
        "double_wishbone" => {
            let [lower, upper] = ["lca_ball", "uca_ball"].map(|n| knuckle.point(v.at(k, n)));
            worse(&mut worst.length, norm(sub(lower, t.vector(row, "lbj", &format!("_{s}")))));
            worse(&mut worst.length, norm(sub(upper, t.vector(row, "ubj", &format!("_{s}")))));
            [lower, upper]
        }
        "macpherson_strut" => {
            let lower = knuckle.point(v.at(k, "lca_ball"));
            worse(&mut worst.length, norm(sub(lower, t.vector(row, "lbj", &format!("_{s}")))));
            let (low, top) = (v.at(k, "strut_lower"), v.at(k, "strut_top"));
            // The top mount on the body lies on the knuckle's line.
            let along = turn(knuckle.q, unit(sub(top, low)));
            let from_low = sub(top, knuckle.point(low));
            worse(&mut worst.length, norm(cross(along, from_low)));
            worse(&mut worst.length, t.get(row, &format!("strut_length_{s}")) - norm(from_low));
            [lower, top]
        }
        _ => return,
    };
    let d = sub(ends[1], ends[0]);
    worse(&mut worst.angle, t.get(row, &format!("caster_{s}")) - (-d[0]).atan2(d[2]));
    worse(&mut worst.angle, t.get(row, &format!("kpi_{s}")) - (-out * d[1]).atan2(d[2]));
}

/// Balance of the knuckle under [(force, point)], moments about the wheel centre, relative to the loads.
fn check_balance(t: &Table, row: usize, s: &str, centre: V, forces: &[(V, V)], worst: &mut Worst) {
    let (mut force, mut moment) = (t.load(row, "F", "b", s), t.load(row, "M", "b", s));
    let scale = norm(force).max(norm(moment));
    for (f, at) in forces {
        force = add(force, *f);
        moment = add(moment, cross(sub(*at, centre), *f));
    }
    worse(&mut worst.balance, norm(force) / scale);
    worse(&mut worst.balance, norm(moment) / scale);
}

/// The pull of a link in tension on its far end.
fn pull(tension: f64, from: V, to: V) -> V {
    times(-tension, unit(sub(to, from)))
}

fn check_forces(t: &Table, v: &Variant, row: usize, suffix: &str, worst: &mut Worst) {
    let bar = suffix == "_arb";
    let mut drive = 0.0;
    for (k, s) in ["L", "R"].into_iter().enumerate() {
        let knuckle = Knuckle::read(t, v, row, k);
        let rack = [0.0, t.get(row, "rack"), 0.0];
        let (inner, to) = (add(v.at(k, "tierod_inner"), rack), knuckle.point(v.at(k, "tierod_outer")));
        let tie = t.get(row, &format!("tie{suffix}_{s}"));
        drive -= tie * unit(sub(to, inner))[1];
        let mut forces = vec![(pull(tie, inner, to), to)];
        let scale = norm(t.load(row, "F", "b", s)).max(1.0);
        let lower =
            knuckle.point(if v.kind == "five_link" { v.at(k, "wheel_centre") } else { v.at(k, "lca_ball") });
        let f_lower = t.vector(row, "Flbj", &format!("{suffix}_{s}"));
        let spring = t.get(row, &format!("spring{suffix}_{s}"));
        match v.kind {
            "double_wishbone" => {
                let upper = knuckle.point(v.at(k, "uca_ball"));
                let f_upper = t.vector(row, "Fubj", &format!("{suffix}_{s}"));
                forces.extend([(f_upper, upper), (f_lower, lower)]);
                // The two upper legs pull along themselves only.
                let normal = cross(sub(v.at(k, "uca_front"), upper), sub(v.at(k, "uca_rear"), upper));
                worse(&mut worst.balance, dot(f_upper, unit(normal)) / scale);
                // The lower arm turns freely about its hinge: spring against ball joint.
                let (rear, hinge) =
                    (v.at(k, "lca_rear"), unit(sub(v.at(k, "lca_front"), v.at(k, "lca_rear"))));
                let design = sub(v.at(k, "lca_ball"), rear);
                let flat = |x: V| sub(x, times(dot(x, hinge), hinge));
                let (a, b) = (flat(design), flat(sub(lower, rear)));
                let angle = dot(hinge, cross(a, b)).atan2(dot(a, b));
                worse(&mut worst.length, norm(sub(add(rear, about(hinge, angle, design)), lower)));
                let seat = add(rear, about(hinge, angle, sub(v.at(k, "spring_lower"), rear)));
                let top = v.at(k, "spring_upper");
                worse(&mut worst.length, t.get(row, &format!("spring_length_{s}")) - norm(sub(top, seat)));
                let on_arm = pull(spring, top, seat);
                let moment =
                    add(cross(sub(seat, rear), on_arm), cross(sub(lower, rear), times(-1.0, f_lower)));
                worse(&mut worst.balance, dot(moment, hinge) / scale);
            }
            "macpherson_strut" => {
                let top = v.at(k, "strut_top");
                let f_top = t.vector(row, "Ftop", &format!("{suffix}_{s}"));
                forces.extend([(f_top, top), (f_lower, lower)]);
                let normal = cross(sub(v.at(k, "lca_front"), lower), sub(v.at(k, "lca_rear"), lower));
                worse(&mut worst.balance, dot(f_lower, unit(normal)) / scale);
                let axis = unit(sub(top, knuckle.point(v.at(k, "strut_lower"))));
                worse(&mut worst.balance, (dot(f_top, axis) - spring) / scale);
                if bar {
                    let (l, r) = (v.at(0, "arb_bush"), v.at(1, "arb_bush"));
                    let (axis, bush) = (unit(sub(l, r)), v.at(k, "arb_bush"));
                    let angle = t.get(row, &format!("arb_angle_{s}"));
                    let end = add(bush, about(axis, angle, sub(v.at(k, "arb_arm_end"), bush)));
                    let upper = knuckle.point(v.at(k, "droplink_upper"));
                    let length = norm(sub(v.at(k, "droplink_upper"), v.at(k, "arb_arm_end")));
                    worse(&mut worst.length, norm(sub(upper, end)) - length);
                    let link = t.get(row, &format!("droplink_{s}"));
                    forces.push((pull(link, end, upper), upper));
                    let (sign, torque) = ([-1.0, 1.0][k], t.get(row, "arb_torque"));
                    let moment = dot(cross(sub(end, bush), pull(link, upper, end)), axis);
                    worse(&mut worst.balance, (moment + sign * torque) / scale);
                    let both = t.get(row, "arb_angle_L") - t.get(row, "arb_angle_R");
                    worse(&mut worst.balance, (torque - v.stiffness.unwrap() * both) / scale);
                }
            }
            _ => {
                // Only sums of two links each are written: forces balance; moments by virtual work below.
                let f_upper = t.vector(row, "Fubj", &format!("{suffix}_{s}"));
                let sum = [t.load(row, "F", "b", s), f_upper, f_lower, forces[0].0];
                let left = sum.into_iter().fold([0.0; 3], add);
                worse(&mut worst.balance, norm(left) / scale);
                continue;
            }
        }
        check_balance(t, row, s, knuckle.centre, &forces, worst);
    }
    worse(&mut worst.balance, (drive - t.get(row, &format!("rack_force{suffix}"))) / drive.abs().max(1000.0));
}

/// Virtual work of everything that acts, by the neighbours of a row: motion of the rack, of a wheel height.
fn check_work(t: &Table, v: &Variant, row: usize, suffix: &str, worst: &mut Worst) {
    for (plus, minus, rack) in [(1, 2, 2.0 * H), (3, 4, 0.0), (5, 6, 0.0)] {
        let (a, b) = (row + minus, row + plus);
        let mut work = rack * t.get(row, &format!("rack_force{suffix}"));
        let mut size = work.abs();
        for (k, s) in ["L", "R"].into_iter().enumerate() {
            let (from, to) = (Knuckle::read(t, v, a, k), Knuckle::read(t, v, b, k));
            let (force, moment) = (t.load(row, "F", "b", s), t.load(row, "M", "b", s));
            // The small rotation between both: 2 (q_b conj(q_a)).
            let (p, q) = (to.q, from.q);
            let (pe, qe) = ([p[1], p[2], p[3]], [q[1], q[2], q[3]]);
            let e = sub(sub(times(q[0], pe), times(p[0], qe)), times(-1.0, cross(qe, pe)));
            let turned = times(2.0, e);
            let length = if v.kind == "macpherson_strut" { "strut" } else { "spring" };
            let name = format!("{length}_length_{s}");
            let spring = -t.get(row, &format!("spring{suffix}_{s}")) * (t.get(b, &name) - t.get(a, &name));
            let mut parts = vec![dot(force, sub(to.centre, from.centre)), dot(moment, turned), spring];
            if suffix == "_arb" {
                let name = format!("arb_angle_{s}");
                let sign = [-1.0, 1.0][k];
                parts.push(sign * t.get(row, "arb_torque") * (t.get(b, &name) - t.get(a, &name)));
            }
            work += parts.iter().sum::<f64>();
            size += parts.iter().map(|x| x.abs()).sum::<f64>();
        }
        worse(&mut worst.work, work / size);
    }
}

const WISHBONE: [[&str; 2]; 4] = [
    ["uca_front", "uca_ball"],
    ["uca_rear", "uca_ball"],
    ["lca_front", "lca_ball"],
    ["lca_rear", "lca_ball"],
];
const STRUT: [[&str; 2]; 2] = [["lca_front", "lca_ball"], ["lca_rear", "lca_ball"]];
const FIVE: [[&str; 2]; 4] = [
    ["upper_front_inner", "upper_front_outer"],
    ["upper_rear_inner", "upper_rear_outer"],
    ["lower_front_inner", "lower_front_outer"],
    ["lower_rear_inner", "lower_rear_outer"],
];

fn check(name: &str, legs: &[[&str; 2]], with_bar: bool) {
    let mut worst = Worst::default();
    for seed in 0..6 {
        let ahead = seed % 2 == 1;
        let variant = Variant::new(name, 0.012, ahead, with_bar, 100 + seed);
        let table = solve(&variant.json(), "json", &input(30, 0.035, 0.05, seed));
        let suffixes: &[&str] = if with_bar { &["_arb", "_noarb"] } else { &[""] };
        for row in 0..table.rows.len() {
            assert_eq!(table.get(row, "status"), 0.0, "{name} seed {seed} row {row}");
            for k in 0..2 {
                check_pose(&table, &variant, row, k, legs, &mut worst);
            }
            for suffix in suffixes {
                check_forces(&table, &variant, row, suffix, &mut worst);
                if row % 7 == 0 {
                    check_work(&table, &variant, row, suffix, &mut worst);
                }
            }
        }
    }
    println!("{name}, bar {with_bar}: {worst:?}");
    assert!(worst.length < 1e-11 && worst.angle < 1e-11, "{worst:?}");
    assert!(worst.balance < 1e-9 && worst.work < 1e-6, "{worst:?}");
}

#[test]
fn double_wishbones_of_all_sorts() {
    check("sedan_double_wishbone", &WISHBONE, false);
}

#[test]
fn struts_of_all_sorts() {
    check("compact_strut", &STRUT, false);
}

#[test]
fn struts_with_skewed_bars() {
    check("compact_strut", &STRUT, true);
}

#[test]
fn five_links_of_all_sorts() {
    check("sedan_five_link", &FIVE, false);
}

/// Double wishbones on bushings: arms' poses from their bushings' deflections and ball joints, both arms'
/// balance of forces and moments.
#[test]
fn bushed_double_wishbones_balance() {
    let mut worst = Worst::default();
    for seed in 0..4 {
        let variant = Variant::new("sedan_double_wishbone", 0.012, seed % 2 == 1, false, 300 + seed);
        let mut axle = Axle::from_hardpoint_json(&variant.json(), "variant").unwrap();
        let stiffness = |k: usize| [8e6 - 1e6 * k as f64, 1e6 + 2e5 * k as f64, 50.0 + 10.0 * k as f64];
        let names = ["uca_front", "uca_rear", "lca_front", "lca_rear"];
        let bushing = |k: usize| {
            let [radial_n_per_m, axial_n_per_m, torsional_n_m_per_rad] = stiffness(k);
            Bushing { radial_n_per_m, axial_n_per_m, torsional_n_m_per_rad, axis: None, damping: None }
        };
        axle.bushings = Some(names.iter().enumerate().map(|(k, n)| ((*n).to_owned(), bushing(k))).collect());
        let table = solve(&toml::to_string(&axle).unwrap(), "toml", &input(20, 0.03, 0.04, seed));
        for row in 0..table.rows.len() {
            for k in 0..2 {
                check_pose(&table, &variant, row, k, &[], &mut worst);
                let s = ["L", "R"][k];
                let knuckle = Knuckle::read(&table, &variant, row, k);
                let scale = norm(table.load(row, "F", "b", s));
                let rack = [0.0, table.get(row, "rack"), 0.0];
                let inner = add(variant.at(k, "tierod_inner"), rack);
                let to = knuckle.point(variant.at(k, "tierod_outer"));
                let tie = pull(table.get(row, &format!("tie_{s}")), inner, to);
                let mut on_knuckle = vec![(tie, to)];
                for (first, arm) in ["uca", "lca"].into_iter().enumerate() {
                    let ends = ["front", "rear"].map(|end| format!("{arm}_{end}"));
                    let design = [0, 1].map(|e| variant.at(k, &ends[e]));
                    let defl =
                        [0, 1].map(|e| table.vector(row, &format!("defl_{}", ends[e]), &format!("_{s}")));
                    let now = [0, 1].map(|e| add(design[e], defl[e]));
                    let ball_design = variant.at(k, &format!("{arm}_ball"));
                    let ball = knuckle.point(ball_design);
                    for (a, b, da, db) in [
                        (now[0], now[1], design[0], design[1]),
                        (now[0], ball, design[0], ball_design),
                        (now[1], ball, design[1], ball_design),
                    ] {
                        worse(&mut worst.length, norm(sub(a, b)) - norm(sub(da, db)));
                    }
                    // The arm's attitude from its three points.
                    let triad = |a: V, b: V, c: V| {
                        let x = unit(sub(a, b));
                        let z = unit(cross(x, sub(c, b)));
                        [x, cross(z, x), z]
                    };
                    let (old, new) = (triad(design[0], design[1], ball_design), triad(now[0], now[1], ball));
                    let turned =
                        |v: V| (0..3).fold([0.0; 3], |sum, c| add(sum, times(dot(old[c], v), new[c])));
                    let columns = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]].map(turned);
                    let spin = [
                        columns[1][2] - columns[2][1],
                        columns[2][0] - columns[0][2],
                        columns[0][1] - columns[1][0],
                    ];
                    let trace = columns[0][0] + columns[1][1] + columns[2][2];
                    let angle = (0.5 * norm(spin)).atan2(0.5 * (trace - 1.0));
                    let phi = if angle > 1e-12 { times(angle / norm(spin), spin) } else { [0.0; 3] };
                    let f_ball = table.vector(row, ["Fubj", "Flbj"][first], &format!("_{s}"));
                    on_knuckle.push((f_ball, ball));
                    let mut forces = vec![(times(-1.0, f_ball), ball)];
                    let mut moment = [0.0; 3];
                    let along = unit(sub(design[0], design[1]));
                    for e in 0..2 {
                        let [radial, axial, torsion] = stiffness(2 * first + e);
                        let axial_part = times(dot(defl[e], along), along);
                        let force = add(times(-axial, axial_part), times(-radial, sub(defl[e], axial_part)));
                        forces.push((force, now[e]));
                        moment = sub(moment, times(torsion, phi));
                    }
                    if arm == "lca" {
                        let seat = add(now[1], turned(sub(variant.at(k, "spring_lower"), design[1])));
                        let top = variant.at(k, "spring_upper");
                        let length = table.get(row, &format!("spring_length_{s}"));
                        worse(&mut worst.length, norm(sub(top, seat)) - length);
                        forces.push((pull(table.get(row, &format!("spring_{s}")), top, seat), seat));
                    }
                    let sum = forces.iter().fold([0.0; 3], |sum, (f, _)| add(sum, *f));
                    let moment =
                        forces.iter().fold(moment, |sum, (f, at)| add(sum, cross(sub(*at, now[1]), *f)));
                    worse(&mut worst.balance, norm(sum) / scale);
                    worse(&mut worst.balance, norm(moment) / scale);
                }
                check_balance(&table, row, s, knuckle.centre, &on_knuckle, &mut worst);
            }
        }
    }
    println!("double wishbone on bushings: {worst:?}");
    assert!(worst.length < 1e-11 && worst.angle < 1e-11 && worst.balance < 1e-8, "{worst:?}");
}
