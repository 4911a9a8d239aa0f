//! Random networks (masses, springs, dampers, transformers; random frames, nestings, loops and rigid joins) against a
//! dense solve of all unknowns written here, in the ground frame, for the transfer from one force to one speed at
//! several rates s; and the same network nested differently.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use nalgebra::{DMatrix, DVector, Matrix2};
use std::fmt::Write;

use functional_model::{CompileOptions, Matrices, Method, Model, Parameters};
use support::{Random, no_files, show};

#[derive(Clone, Copy, PartialEq)]
enum Kind {
    Mass,
    Spring,
    Damper,
    Ratio,
}

/// A part: kind, matrix in its own axes, direction of those axes, joints of its ports (None = fixed to the ground).
struct Part {
    kind: Kind,
    matrix: [f64; 4],
    angle: f64,
    joints: Vec<Option<usize>>,
}

struct Network {
    joints: usize,
    parts: Vec<Part>,
}

fn generate(seed: u64) -> Network {
    let mut r = Random(seed);
    let joints = 2 + r.below(8);
    let mut parts = Vec::new();
    let mut part = |r: &mut Random, kind: Kind, joints: Vec<Option<usize>>| {
        let size = |r: &mut Random| match kind {
            Kind::Mass => r.log(0.5, 20.0),
            Kind::Spring => r.log(50.0, 5e3),
            Kind::Damper => r.log(1.0, 100.0),
            Kind::Ratio => r.between(0.5, 2.0) * if r.below(2) == 0 { -1.0 } else { 1.0 },
        };
        let (x, y) = (size(r), size(r));
        let off = if kind == Kind::Ratio { r.between(-0.3, 0.3) } else { 0.0 };
        // Masses as they are in nature: the same in every direction, or a given ratio.
        parts.push(Part { kind, matrix: [x, off, -off, y], angle: r.between(-3.1, 3.1), joints });
    };
    // The first joint carries the driven mass; a tree joins the others, so that ratios never close a rigid loop.
    part(&mut r, Kind::Mass, vec![Some(0)]);
    for j in 1..joints {
        let to = r.below(j);
        let kind = [Kind::Spring, Kind::Damper, Kind::Ratio][r.below(3)];
        part(&mut r, kind, vec![Some(to), Some(j)]);
        for _ in 0..r.below(3) {
            part(&mut r, Kind::Mass, vec![Some(j)]);
        }
    }
    for _ in 0..r.below(8) {
        let (a, b) = (r.below(joints), r.below(joints));
        let kind = if r.below(2) == 0 { Kind::Spring } else { Kind::Damper };
        if a != b {
            let end = if r.below(4) == 0 { None } else { Some(b) };
            part(&mut r, kind, vec![Some(a), end]);
        }
    }
    Network { joints, parts }
}

/// All unknowns at once: speeds of joints and forces of ports, in the ground frame.
fn dense(n: &Network, s: f64) -> (Matrix2<f64>, f64) {
    let ports: usize = n.parts.iter().map(|p| p.joints.len()).sum();
    let size = 2 * (n.joints + ports);
    let mut a = DMatrix::<f64>::zeros(size, size);
    let (mut row, mut port) = (2 * n.joints, n.joints);
    for p in &n.parts {
        let turn = Matrix2::new(p.angle.cos(), -p.angle.sin(), p.angle.sin(), p.angle.cos());
        let m = turn * Matrix2::new(p.matrix[0], p.matrix[1], p.matrix[2], p.matrix[3]) * turn.transpose();
        let put = |a: &mut DMatrix<f64>, row: usize, block: Option<usize>, m: Matrix2<f64>| {
            if let Some(b) = block {
                for i in 0..2 {
                    for j in 0..2 {
                        a[(row + i, 2 * b + j)] += m[(i, j)];
                    }
                }
            }
        };
        let id = Matrix2::identity();
        // Force a port puts on its joint: F.
        match p.kind {
            Kind::Mass => {
                put(&mut a, row, Some(port), id);
                put(&mut a, row, p.joints[0], m * s);
            }
            Kind::Spring | Kind::Damper => {
                let k = if p.kind == Kind::Spring { m / s } else { m };
                put(&mut a, row, Some(port), id);
                put(&mut a, row, p.joints[0], k);
                put(&mut a, row, p.joints[1], -k);
                put(&mut a, row + 2, Some(port + 1), id);
                put(&mut a, row + 2, p.joints[0], -k);
                put(&mut a, row + 2, p.joints[1], k);
            }
            Kind::Ratio => {
                put(&mut a, row, p.joints[1], id);
                put(&mut a, row, p.joints[0], -m);
                put(&mut a, row + 2, Some(port), id);
                put(&mut a, row + 2, Some(port + 1), m.transpose());
            }
        }
        for j in &p.joints {
            if let Some(j) = j {
                for i in 0..2 {
                    a[(2 * j + i, 2 * port + i)] += 1.0;
                }
            }
            port += 1;
            row += 2;
        }
    }
    // Equilibrated by rows and columns before judging the condition.
    let mut g = Matrix2::zeros();
    let rows: Vec<f64> = (0..size).map(|i| a.row(i).amax()).collect();
    let scaled = DMatrix::from_fn(size, size, |i, j| a[(i, j)] / rows[i]);
    let columns: Vec<f64> = (0..size).map(|j| scaled.column(j).amax()).collect();
    let scaled = DMatrix::from_fn(size, size, |i, j| scaled[(i, j)] / columns[j]);
    let values = scaled.clone().svd(false, false).singular_values;
    let condition = values.max() / values.min();
    let lu = scaled.lu();
    for k in 0..2 {
        let mut b = DVector::zeros(size);
        b[k] = -1.0 / rows[k];
        let x = lu.solve(&b).unwrap();
        g[(0, k)] = x[0] / columns[0];
        g[(1, k)] = x[1] / columns[1];
    }
    (g, condition)
}

/// The network as a model file. Groups of parts share a frame; every part may sit in one more frame of its own.
fn write_model(n: &Network, nesting: u64) -> String {
    let mut r = Random(nesting);
    let groups = r.below(4);
    let turn: Vec<f64> = (0..groups).map(|_| r.between(-3.0, 3.0)).collect();
    let group: Vec<Option<usize>> = n
        .parts
        .iter()
        .map(|_| if groups > 0 && r.below(3) > 0 { Some(r.below(groups)) } else { None })
        .collect();
    let deep: Vec<Option<f64>> =
        n.parts.iter().map(|_| (r.below(3) == 0).then(|| r.between(-3.0, 3.0))).collect();
    let mut text = String::from("format = \"kingpin-model/1\"\ndim = 2\nfree = []\n");
    let name = |i: usize| format!("p{i}");
    let port = |k: usize| ["a", "b"][k];
    // A joint inside one group is written in that group.
    let inside = |j: usize| -> Option<usize> {
        let mut owner = None;
        for (i, p) in n.parts.iter().enumerate() {
            if p.joints.contains(&Some(j)) {
                match (owner, group[i]) {
                    (_, None) => return None,
                    (None, g) => owner = g,
                    (Some(o), Some(g)) if o != g => return None,
                    _ => {}
                }
            }
        }
        owner
    };
    let single = |j: usize| n.parts.iter().flat_map(|p| &p.joints).filter(|x| **x == Some(j)).count() == 1;
    let members = |j: usize, within: Option<usize>| -> Vec<String> {
        let mut v = Vec::new();
        for (i, p) in n.parts.iter().enumerate() {
            for (k, x) in p.joints.iter().enumerate() {
                if *x == Some(j) {
                    match (group[i], within) {
                        (Some(g), None) => v.push(format!("\"g{g}.{}_{}\"", name(i), port(k))),
                        _ => v.push(format!("\"{}.{}\"", name(i), port(k))),
                    }
                }
            }
        }
        v
    };
    let mut top_free = Vec::new();
    let mut top_fixed = Vec::new();
    let mut free = vec![Vec::new(); groups];
    let mut fixed = vec![Vec::new(); groups];
    let mut couplings = vec![String::new(); groups];
    let mut top_couplings = String::new();
    for j in 0..n.joints {
        let owner = inside(j);
        let m = members(j, owner);
        if m.len() == 1 && single(j) {
            match owner {
                Some(g) => free[g].push(m[0].clone()),
                None => top_free.push(m[0].clone()),
            }
        } else if m.len() > 1 {
            let line = format!("{{ join = [{}] }},\n", m.join(", "));
            match owner {
                Some(g) => couplings[g].push_str(&line),
                None => top_couplings.push_str(&line),
            }
        }
    }
    let mut exposed = vec![String::new(); groups];
    for (i, p) in n.parts.iter().enumerate() {
        for (k, x) in p.joints.iter().enumerate() {
            match (x, group[i]) {
                (None, Some(g)) => fixed[g].push(format!("\"{}.{}\"", name(i), port(k))),
                (None, None) => top_fixed.push(format!("\"{}.{}\"", name(i), port(k))),
                (Some(j), Some(g)) if inside(*j).is_none() => {
                    writeln!(exposed[g], "{0}_{1} = \"{0}.{1}\"", name(i), port(k)).unwrap();
                }
                _ => {}
            }
        }
    }
    // The drive: the first mass has a second port.
    if let Some(g) = group[0] {
        writeln!(exposed[g], "drive = \"p0.drive\"").unwrap();
    }
    text = text.replace(
        "free = []\n",
        &format!(
            "free = [{}]\nfixed = [{}]\ncouplings = [\n{top_couplings}]\n",
            top_free.join(", "),
            top_fixed.join(", ")
        ),
    );
    let drive = match group[0] {
        Some(g) => format!("g{g}.drive"),
        None => "p0.drive".into(),
    };
    writeln!(text, "[ports]\ndrive = {{ of = \"{drive}\", positive = \"in\" }}").unwrap();
    for g in 0..groups {
        writeln!(
            text,
            "[parts.g{g}]\nturn = \"{:.17e} rad\"\nfree = [{}]\nfixed = [{}]\ncouplings = [\n{}]\n[parts.g{g}.ports]\n{}",
            turn[g],
            free[g].join(", "),
            fixed[g].join(", "),
            couplings[g],
            exposed[g]
        )
        .unwrap();
    }
    for (i, p) in n.parts.iter().enumerate() {
        let host = group[i].map_or(String::from("parts"), |g| format!("parts.g{g}.parts"));
        let outer = group[i].map_or(0.0, |g| turn[g]);
        let own = p.angle - outer - deep[i].unwrap_or(0.0);
        let m = format!("[[{:e}, {:e}], [{:e}, {:e}]]", p.matrix[0], p.matrix[1], p.matrix[2], p.matrix[3]);
        let two = "ports.a = { across = \"va [m/s]\", through = \"fa [N]\", gives = \"through\" }\nports.b = { across = \"vb [m/s]\", through = \"fb [N]\", gives = \"GIVES\" }\n";
        let content = match p.kind {
            Kind::Mass => {
                let second = if i == 0 {
                    "ports.drive = { across = \"vd [m/s]\", through = \"fd [N]\", gives = \"across\" }\nrows.vd = [\"1\", \"0\", \"0\"]\n"
                } else {
                    ""
                };
                let columns = if i == 0 { "[\"v\", \"f\", \"fd\"]" } else { "[\"v\", \"f\"]" };
                let entries = if i == 0 { "[\"0\", \"-1\", \"-1\"]" } else { "[\"0\", \"-1\"]" };
                let given = if i == 0 { "[\"1\", \"0\", \"0\"]" } else { "[\"1\", \"0\"]" };
                format!(
                    "states = {{ v = \"m/s\" }}\nports.a = {{ across = \"va [m/s]\", through = \"f [N]\", gives = \"across\" }}\n{second}columns = {columns}\nrows.\"{m} kg*v'\" = {entries}\nrows.va = {given}\n"
                )
            }
            Kind::Spring => format!(
                "states = {{ x = \"m\" }}\n{}equations = {{ \"x'\" = \"va - vb\", fa = \"{m} N/m*x\", fb = \"-{m} N/m*x\" }}\n",
                two.replace("GIVES", "through")
            ),
            Kind::Damper => format!(
                "{}equations = {{ fa = \"{m} N*s/m*(va - vb)\", fb = \"-{m} N*s/m*(va - vb)\" }}\n",
                two.replace("GIVES", "through")
            ),
            Kind::Ratio => {
                format!("{}ratio.vb = {{ of = \"va\", is = \"{m}\" }}\n", two.replace("GIVES", "across"))
            }
        };
        match deep[i] {
            None => writeln!(text, "[{host}.{}]\nturn = \"{own:.17e} rad\"\n{content}", name(i)).unwrap(),
            Some(d) => {
                let mut ports = String::new();
                for k in 0..p.joints.len() {
                    writeln!(ports, "ports.{0} = \"inner.{0}\"", port(k)).unwrap();
                }
                if i == 0 {
                    ports.push_str("ports.drive = \"inner.drive\"\n");
                }
                writeln!(text, "[{host}.{0}]\nturn = \"{d:.17e} rad\"\n{ports}[{host}.{0}.parts.inner]\nturn = \"{own:.17e} rad\"\n{content}", name(i)).unwrap();
            }
        }
    }
    text
}

/// C (sE - A)^-1 B + D
fn transfer(m: &Matrices, s: f64) -> Matrix2<f64> {
    let n = m.states.len();
    let a = DMatrix::from_fn(n, n, |i, j| s * m.e[i][j] - m.a[i][j]);
    let b = DMatrix::from_fn(n, 2, |i, j| m.b[i][j]);
    let rows: Vec<f64> = (0..n).map(|i| a.row(i).amax()).collect();
    let x = DMatrix::from_fn(n, n, |i, j| a[(i, j)] / rows[i])
        .full_piv_lu()
        .solve(&DMatrix::from_fn(n, 2, |i, j| b[(i, j)] / rows[i]))
        .unwrap();
    Matrix2::from_fn(|i, j| (0..n).map(|k| m.c[i][k] * x[(k, j)]).sum::<f64>() + m.d[i][j])
}

#[test]
fn random_networks_agree_with_a_dense_solve() {
    let (mut worst, mut judged, mut reduced, mut blocks) = (0.0f64, 0, 0, 0);
    let count = std::env::var("NETWORKS").ok().and_then(|v| v.parse().ok()).unwrap_or(200);
    for seed in 0..count {
        let n = generate(seed);
        let text = write_model(&n, seed + 77);
        let model = match Model::from_toml(&text, "network", &no_files) {
            Ok(m) => m,
            Err(e) => panic!("seed {seed}\n{text}\n{e:?}"),
        };
        let system = match model.compose(&Parameters::new()) {
            Ok(s) => s,
            Err(e) => panic!("seed {seed}\n{text}\n{e:?}"),
        };
        reduced += usize::from(!system.dependent_states().is_empty());
        blocks = blocks.max(n.parts.len());
        let m = show(system.matrices());
        for s in [0.7, 11.0] {
            let (g, condition) = dense(&n, s);
            if condition > 1e8 {
                continue;
            }
            judged += 1;
            let got = transfer(&m, s);
            let off = (got - g).norm() / g.norm();
            assert!(
                off < 1e-9,
                "seed {seed}, s {s}: off by {off:e}, condition {condition:e}\n{got} {g}\n{text}"
            );
            worst = worst.max(off);
        }
    }
    println!(
        "{judged} comparisons of {count} networks of up to {blocks} blocks ({reduced} with rigid joins): worst {worst:.1e}"
    );
    assert!(judged > count as usize && reduced > count as usize / 5);
}

#[test]
fn any_nesting_gives_the_same_trajectory() {
    let mut worst = 0.0f64;
    for seed in 0..20 {
        let n = generate(seed + 1000);
        let run = |nesting: u64| -> Vec<f64> {
            let model = show(Model::from_toml(&write_model(&n, nesting), "network", &no_files));
            let mut c = show(
                show(model.compose(&Parameters::new()))
                    .compile(CompileOptions { method: Some(Method::Exact), account: false }),
            );
            let mut path = Vec::new();
            for k in 0..200 {
                let t = f64::from(k) * 0.01;
                c.step(&[(3.0 * t).sin(), (2.0 * t).cos()], 0.01);
                path.extend_from_slice(c.outputs());
            }
            path
        };
        let first = run(5);
        for nesting in [6, 7, 8] {
            let off = support::relative(&run(nesting), &first);
            assert!(off < 1e-10, "seed {seed} nesting {nesting}: {off:e}");
            worst = worst.max(off);
        }
    }
    println!("re-nestings: worst {worst:.1e} of the largest speed");
}
