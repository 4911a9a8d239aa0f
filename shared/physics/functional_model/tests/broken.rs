//! Broken models: each mistake is reported with its rule, its line and the part or port, in words.
#![allow(clippy::unwrap_used, clippy::expect_used, clippy::panic, clippy::print_stdout, missing_docs)]

mod support;

use functional_model::{CompileOptions, Method, Model, ModelError, Parameters, Rule};

const GOOD: &str = r#"format = "kingpin-model/1"
dim = 2
[parameters]
M = "2 kg"
D = "3 N*s/m"
[ports]
push = "mass.outer"
[start]
"mass.v" = "[1, 0] m/s"
[parts.mass]
states = { v = "m/s" }
ports.inner = { across = "vi [m/s]", through = "fi [N]", gives = "across" }
ports.outer = { across = "vo [m/s]", through = "fo [N]", gives = "across" }
columns = ["v", "fi", "fo"]
rows."M*v'" = ["0", "-1", "-1"]
rows.vi = ["1", "0", "0"]
rows.vo = ["1", "0", "0"]
[parts.damper]
turn = "30 deg"
ports.end = { across = "v [m/s]", through = "f [N]", gives = "through" }
equations.f = "D*v"
[[couplings]]
join = ["mass.inner", "damper.end"]
"#;

fn files(name: &str) -> Result<String, String> {
    match name {
        "loop.toml" => {
            Ok("format = \"kingpin-model/1\"\ndim = 2\n[parts.again]\nuse = \"loop.toml\"\n".into())
        }
        _ => Err("no such file".into()),
    }
}

fn errors(text: &str) -> Vec<ModelError> {
    match Model::from_toml(text, "broken.toml", &files) {
        Err(e) => e,
        Ok(m) => match m.compose(&Parameters::new()) {
            Err(e) => e,
            Ok(s) => s.compile(CompileOptions::default()).err().unwrap_or_default(),
        },
    }
}

/// Replaces one piece of the good model; the mistake must be reported with this rule, near this line, naming this.
fn check(from: &str, to: &str, rule: Rule, names: &[&str]) {
    assert!(GOOD.contains(from), "{from}");
    let text = GOOD.replace(from, to);
    let found = errors(&text);
    for e in &found {
        println!("{e}");
    }
    let first = to.lines().find(|l| !l.is_empty()).unwrap_or(to);
    let line = text.lines().position(|l| l.contains(first)).map_or(0, |l| l + 1);
    let lines = line..=line + to.lines().count().max(1);
    let hit = found.iter().find(|e| {
        let all = e.to_string();
        e.rule == rule && names.iter().all(|n| all.contains(n))
    });
    let Some(hit) = hit else { panic!("no {rule:?} naming {names:?} in {found:?}") };
    assert!(hit.line > 0 || rule == Rule::SingularLoop, "no line: {hit:?}");
    // A wrong parameter shows where it is used.
    if !from.starts_with("D =")
        && to.lines().count() == 1
        && !to.is_empty()
        && !matches!(rule, Rule::EquationCount | Rule::Unconnected | Rule::SingularLoop | Rule::Dimension)
    {
        assert!(lines.contains(&hit.line), "line {} of {lines:?}: {hit}", hit.line);
    }
}

#[test]
fn the_good_model_is_good() {
    assert_eq!(errors(GOOD), []);
}

#[test]
fn form_and_names() {
    check("[parameters]", "[parameter]", Rule::Format, &["parameter", "did you mean 'parameters'"]);
    check("M = \"2 kg\"", "M = \"2 kg", Rule::Format, &["TOML"]);
    check("gives = \"through\"", "gives = \"effort\"", Rule::Format, &["damper.end", "effort"]);
    check("\"kingpin-model/1\"", "\"kingpin-model/9\"", Rule::Format, &["kingpin-model/9"]);
    check("\"D*v\"", "\"D*(v\"", Rule::Expression, &["damper", "')'"]);
    check("\"D*v\"", "\"Dx*v\"", Rule::UnknownName, &["damper", "'Dx'", "did you mean 'D'"]);
    check("\"damper.end\"", "\"damper.edn\"", Rule::UnknownName, &["damper.edn", "ports: end"]);
    check("\"damper.end\"", "\"dampr.end\"", Rule::UnknownName, &["dampr", "parts: mass, damper"]);
    check("\"mass.v\" =", "\"mass.w\" =", Rule::UnknownName, &["mass.w"]);
}

#[test]
fn units_and_sizes() {
    check("\"D*v\"", "\"D*v^2\"", Rule::Unit, &["damper", "N"]);
    check("D = \"3 N*s/m\"", "D = \"3 N*m\"", Rule::Unit, &["damper"]);
    check("M = \"2 kg\"", "M = \"2 kg + 1 s\"", Rule::Unit, &["M", "cannot add"]);
    check("through = \"f [N]\"", "through = \"f [N*m]\"", Rule::Unit, &["damper.end", "not a power"]);
    check("\"[1, 0] m/s\"", "\"[1, 0] m\"", Rule::Unit, &["mass.v"]);
    check("\"[1, 0] m/s\"", "\"[1, 0, 0] m/s\"", Rule::Dimension, &["mass.v"]);
    check("turn = \"30 deg\"", "dim = 0", Rule::Dimension, &["damper.end", "along, turn"]);
    check("turn = \"30 deg\"", "dim = 3", Rule::Dimension, &["damper", "dim = 3"]);
    check("turn = \"30 deg\"", "turn = \"30 kg\"", Rule::Unit, &["angle"]);
    check("turn = \"30 deg\"", "dim = 0\nalong = [\"1\", \"1\"]", Rule::Value, &["damper", "length"]);
    check(
        "columns = [\"v\", \"fi\", \"fo\"]",
        "columns = [\"v\", \"fi\"]",
        Rule::EquationCount,
        &["mass", "entries"],
    );
}

#[test]
fn structure() {
    check(
        "\n[[couplings]]\njoin = [\"mass.inner\", \"damper.end\"]\n",
        "\n",
        Rule::Unconnected,
        &["mass.inner"],
    );
    check("rows.vo = [\"1\", \"0\", \"0\"]\n", "", Rule::EquationCount, &["mass.outer", "vo"]);
    check(
        "push = \"mass.outer\"",
        "push = \"mass.outer\"\nagain = \"mass.outer\"",
        Rule::TwoHosts,
        &["mass.outer", "already joined"],
    );
    check(
        "turn = \"30 deg\"",
        "turn = \"30 deg\"\nmatrix = [[\"1\", \"0\"], [\"0\", \"1\"]]",
        Rule::TwoHosts,
        &["damper", "placed twice"],
    );
    check(
        "[parts.damper]\n",
        "[parts.odd]\nuse = \"loop.toml\"\n[parts.damper]\n",
        Rule::CyclicNesting,
        &["contains itself", "loop.toml"],
    );
    check(
        "[parts.damper]\n",
        "[parts.odd]\nuse = \"lost.toml\"\n[parts.damper]\n",
        Rule::Resolve,
        &["lost.toml", "no such file"],
    );
    check(
        "[parts.damper]\n",
        "[parts.box]\nparts.d.use = \"library/damper.toml\"\nports.a = \"d.a\"\nports.b = \"d.b\"\n[parts.damper]\n",
        Rule::Unconnected,
        &["box.d.a"],
    );
    let deep = GOOD
        .replace("\"damper.end\"", "\"box.damper.end\"")
        .replace("[parts.damper]", "[parts.box.parts.damper]");
    let found = errors(&deep);
    assert!(
        found.iter().any(|e| e.rule == Rule::TwoHosts && e.to_string().contains("its host")),
        "{found:?}"
    );
}

#[test]
fn loops_and_storages() {
    // A loss that makes the loop of the two losses singular: 100 - 100.
    let text = |d: &str| {
        format!(
            "format = \"kingpin-model/1\"\nports = {{ l = \"a.a\", r = \"b.b\" }}\n[parts.a]\nuse = \"library/damper.toml\"\n[parts.b]\nuse = \"library/damper.toml\"\nset = {{ d = \"{d}\" }}\n[[couplings]]\njoin = [\"a.b\", \"b.a\"]\n"
        )
    };
    assert_eq!(errors(&text("50 N*s/m")), []);
    let found = errors(&text("-100 N*s/m"));
    println!("{found:?}");
    assert!(
        found.iter().any(|e| e.rule == Rule::SingularLoop && e.place.contains("of a") && e.line > 0),
        "{found:?}"
    );

    // A speed from outside forced on a mass: its rate would be needed.
    let found = errors(
        "format = \"kingpin-model/1\"\nports.drive = \"g.input\"\n[parts.g]\nuse = \"library/gear.toml\"\n[parts.m]\nuse = \"library/inertia.toml\"\n[[couplings]]\njoin = [\"g.output\", \"m.shaft\"]\n",
    );
    println!("{found:?}");
    assert!(
        found.iter().any(|e| e.rule == Rule::Irreducible && e.message.contains("drive.wi") && e.line > 0),
        "{found:?}"
    );

    // Rigidly joined, with contradicting starts.
    let found = errors(
        "format = \"kingpin-model/1\"\nstart = { \"a.w\" = \"1 rad/s\", \"b.w\" = \"2 rad/s\" }\n[parts.a]\nuse = \"library/inertia.toml\"\n[parts.b]\nuse = \"library/inertia.toml\"\n[[couplings]]\njoin = [\"a.shaft\", \"b.shaft\"]\n",
    );
    println!("{found:?}");
    assert!(
        found.iter().any(|e| e.rule == Rule::Start && e.place.contains("a.w") && e.place.contains("b.w")),
        "{found:?}"
    );

    // Two ideal gears side by side: the sharing of torque between them is undetermined.
    let found = errors(
        "format = \"kingpin-model/1\"\n[parts.a]\nuse = \"library/inertia.toml\"\n[parts.b]\nuse = \"library/inertia.toml\"\n[parts.g]\nuse = \"library/gear.toml\"\n[parts.h]\nuse = \"library/gear.toml\"\n[[couplings]]\njoin = [\"a.shaft\", \"g.input\", \"h.input\"]\n[[couplings]]\njoin = [\"g.output\", \"h.output\", \"b.shaft\"]\n",
    );
    println!("{found:?}");
    assert!(found.iter().any(|e| e.rule == Rule::SingularLoop && e.to_string().contains('g')), "{found:?}");
}

#[test]
fn parameters_and_methods() {
    let model = Model::from_toml(GOOD, "good", &files).unwrap();
    let bad = |name: &str, value: &str| model.compose(&Parameters::new().with(name, value)).err().unwrap();
    let e = bad("Q", "1");
    assert!(e[0].rule == Rule::UnknownName && e[0].to_string().contains("'Q'"), "{e:?}");
    let e = bad("M", "2 m");
    assert!(e[0].rule == Rule::Unit, "{e:?}");
    let e = bad("D", "[1 N*s/m, 2 N*s/m, 3 N*s/m]");
    assert!(e[0].rule == Rule::Dimension, "{e:?}");

    let nonlinear = GOOD.replace("\"D*v\"", "\"D*v*norm(v)/(1 m/s)\"");
    let m = Model::from_toml(&nonlinear, "good", &files).unwrap();
    let s = m.compose(&Parameters::new()).unwrap();
    let e = s.compile(CompileOptions { method: Some(Method::Exact), account: false }).err().unwrap();
    assert!(e[0].rule == Rule::Method && e[0].place.contains("damper") && e[0].line > 0, "{e:?}");
    let odd = GOOD.replace("[start]", "[run]\nmethod = \"euler\"\n[start]");
    assert!(errors(&odd).iter().any(|e| e.rule == Rule::Method && e.message.contains("euler")));
}
