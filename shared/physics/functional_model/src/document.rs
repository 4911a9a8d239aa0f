//! The model file format `kingpin-model/1`: which tables and keys there are, read into plain structures. Nothing is
//! interpreted here beyond form; expressions stay text with their line. The keys are documented in the crate's
//! front page.

use std::rc::Rc;

use crate::error::{ModelError, Place, Rule};
use crate::expand::distance;
use crate::node::{Item, Node, Text};

/// One model, part or block.
#[derive(Debug, Clone, Default)]
pub(crate) struct Raw {
    pub place: Place,
    pub name: Option<String>,
    pub about: Option<String>,
    pub dim: Option<(usize, Place)>,
    pub parameters: Vec<(String, Text)>,
    pub inputs: Vec<(String, Text)>,
    pub tables: Vec<RawTable>,
    pub ports: Vec<(String, RawPort)>,
    pub states: Vec<RawState>,
    /// Scalars a block computes for others to read, without power.
    pub signals: Vec<(String, Text)>,
    pub locals: Vec<(String, Text)>,
    pub columns: Option<(Vec<Text>, Place)>,
    pub rows: Vec<(Text, Vec<Text>)>,
    pub equations: Vec<(Text, Text)>,
    pub ratios: Vec<RawRatio>,
    pub energy: Option<Text>,
    pub loss: Option<Text>,
    pub supply: Option<Text>,
    pub parts: Vec<RawPart>,
    pub couplings: Vec<RawCoupling>,
    /// Ports whose through is zero.
    pub free: Vec<Text>,
    /// Ports whose across is zero.
    pub fixed: Vec<Text>,
    pub mechanisms: Vec<RawMechanism>,
    pub observe: Vec<RawObserve>,
    pub start: Vec<(String, Text)>,
    pub sample: Option<Text>,
    pub method: Option<Text>,
    pub models: Vec<(String, Rc<Raw>)>,
}

impl Raw {
    /// A block has equations of its own; a composite has parts.
    pub fn is_block(&self) -> bool {
        self.parts.is_empty() && self.couplings.is_empty()
    }
}

#[derive(Debug, Clone)]
pub(crate) enum RawPort {
    /// A port of a part, seen from outside.
    Alias {
        of: Text,
        inward: bool,
    },
    Own {
        across: Text,
        through: Text,
        gives: Text,
        scalar: bool,
        place: Place,
    },
}

#[derive(Debug, Clone)]
pub(crate) struct RawState {
    pub name: String,
    pub unit: Text,
    pub scalar: bool,
    /// Components follow the frame without transport (an orientation-free list, not a vector).
    pub transport: bool,
}

#[derive(Debug, Clone)]
pub(crate) struct RawRatio {
    pub gives: Text,
    pub terms: Vec<(Text, Text)>,
    pub gyrator: bool,
}

#[derive(Debug, Clone)]
pub(crate) struct RawPart {
    pub name: String,
    pub place: Place,
    pub uses: Option<Text>,
    pub along: Option<Text>,
    pub turn: Vec<(char, Text)>,
    pub matrix: Option<Text>,
    pub spin: Option<Text>,
    pub set: Vec<(String, Text)>,
    pub feed: Vec<(String, Text)>,
    pub content: Rc<Raw>,
}

#[derive(Debug, Clone)]
pub(crate) struct RawCoupling {
    pub place: Place,
    pub join: Vec<Text>,
    /// Shared through, across sums to zero.
    pub series: bool,
}

#[derive(Debug, Clone)]
pub(crate) struct RawMechanism {
    pub name: String,
    pub place: Place,
    pub reads: Vec<(String, Text)>,
    pub gives: Vec<(String, Text)>,
    pub rule: Vec<(String, Text)>,
    pub start: Vec<(String, Text)>,
    pub hold: Option<Text>,
    /// Evaluated continuously instead of once a sample.
    pub always: bool,
}

#[derive(Debug, Clone)]
pub(crate) struct RawObserve {
    pub name: String,
    pub of: Text,
    pub frame: Option<Text>,
}

#[derive(Debug, Clone)]
pub(crate) struct RawTable {
    pub name: String,
    pub place: Place,
    pub x: Option<Text>,
    pub y: Option<Text>,
    pub value: Option<Text>,
    pub file: Option<Text>,
    pub cubic: bool,
}

/// Reads the tree of one file.
pub(crate) fn read(root: &Node) -> Result<Raw, Vec<ModelError>> {
    let mut r = Reader { errors: Vec::new() };
    let raw = r.model(root, true);
    if r.errors.is_empty() { Ok(raw) } else { Err(r.errors) }
}

struct Reader {
    errors: Vec<ModelError>,
}

pub(crate) const MODEL_KEYS: &[&str] = &[
    "format",
    "name",
    "about",
    "dim",
    "parameters",
    "inputs",
    "tables",
    "ports",
    "states",
    "signals",
    "where",
    "columns",
    "rows",
    "equations",
    "ratio",
    "gyrator",
    "energy",
    "loss",
    "supply",
    "parts",
    "couplings",
    "free",
    "fixed",
    "mechanism",
    "observe",
    "start",
    "run",
    "model",
];
pub(crate) const PLACING_KEYS: &[&str] = &["use", "along", "turn", "matrix", "spin", "set", "feed"];

impl Reader {
    fn fail(&mut self, place: &Place, what: &str, message: String) {
        self.errors.push(place.error(Rule::Format, what, message));
    }

    fn table<'n>(&mut self, node: &'n Node, what: &str) -> &'n [(String, Node)] {
        match &node.value {
            Item::Table(t) => t,
            other => {
                self.fail(&node.place, what, format!("a table is expected here, not {}", other.kind()));
                &[]
            }
        }
    }

    fn unknown(&mut self, key: &str, node: &Node, what: &str, known: &[&str]) {
        let near = known.iter().map(|k| (distance(k, key), k)).min().filter(|(d, _)| *d <= 2);
        let hint = near.map_or_else(
            || format!("; known: {}", known.join(", ")),
            |(_, k)| format!("; did you mean '{k}'?"),
        );
        self.fail(&node.place, what, format!("unknown key '{key}'{hint}"));
    }

    fn text(&mut self, node: &Node, what: &str) -> Text {
        node.text().unwrap_or_else(|| {
            self.fail(&node.place, what, format!("text is expected here, not {}", node.value.kind()));
            Text { text: "0".into(), place: node.place.clone() }
        })
    }

    fn expression(&mut self, node: &Node, what: &str) -> Text {
        let text = node.expression().unwrap_or_else(|| {
            self.fail(
                &node.place,
                what,
                format!("an expression is expected here, not {}", node.value.kind()),
            );
            "0".into()
        });
        Text { text, place: node.place.clone() }
    }

    fn named(&mut self, node: &Node, what: &str) -> Vec<(String, Text)> {
        let table = self.table(node, what);
        table.iter().map(|(k, v)| (k.clone(), self.expression(v, &format!("{what}.{k}")))).collect()
    }

    fn list<'n>(&mut self, node: &'n Node, what: &str) -> &'n [Node] {
        match &node.value {
            Item::List(l) => l,
            other => {
                self.fail(&node.place, what, format!("a list is expected here, not {}", other.kind()));
                &[]
            }
        }
    }

    fn truth(&mut self, node: &Node, what: &str) -> bool {
        match node.value {
            Item::Truth(b) => b,
            _ => {
                self.fail(&node.place, what, "true or false is expected here".into());
                false
            }
        }
    }

    fn model(&mut self, node: &Node, file: bool) -> Raw {
        let mut raw = Raw { place: node.place.clone(), ..Raw::default() };
        let table = self.table(node, "model");
        for (key, v) in table {
            self.model_key(&mut raw, key, v, MODEL_KEYS);
        }
        if file && !table.iter().any(|(k, _)| k == "format") {
            self.fail(&node.place, "format", "the file must say format = \"kingpin-model/1\"".into());
        }
        raw
    }

    fn model_key(&mut self, raw: &mut Raw, key: &str, v: &Node, known: &[&str]) {
        match key {
            "format" => {
                let t = self.text(v, "format");
                if t.text != "kingpin-model/1" {
                    self.fail(&v.place, "format", format!("'{}' is not kingpin-model/1", t.text));
                }
            }
            "name" => raw.name = Some(self.text(v, "name").text),
            "about" => raw.about = Some(self.text(v, "about").text),
            "dim" => match v.value {
                Item::Number(n) if (0.0..=3.0).contains(&n) && n.fract() == 0.0 => {
                    raw.dim = Some((n as usize, v.place.clone()));
                }
                _ => self.fail(&v.place, "dim", "dim is 0, 1, 2 or 3".into()),
            },
            "parameters" => raw.parameters = self.named(v, "parameters"),
            "inputs" => raw.inputs = self.named(v, "inputs"),
            "tables" => {
                for (name, t) in self.table(v, "tables") {
                    let t = self.lookup(name, t);
                    raw.tables.push(t);
                }
            }
            "ports" => {
                for (name, p) in self.table(v, "ports") {
                    if let Some(port) = self.port(name, p) {
                        raw.ports.push((name.clone(), port));
                    }
                }
            }
            "states" => {
                for (name, s) in self.table(v, "states") {
                    let state = self.state(name, s);
                    raw.states.push(state);
                }
            }
            "signals" => raw.signals = self.named(v, "signals"),
            "where" => raw.locals = self.named(v, "where"),
            "columns" => {
                let columns = self.list(v, "columns").iter().map(|c| self.expression(c, "columns")).collect();
                raw.columns = Some((columns, v.place.clone()));
            }
            "rows" => {
                for (label, r) in self.table(v, "rows") {
                    let entries = self.list(r, label).iter().map(|c| self.expression(c, label)).collect();
                    raw.rows.push((Text { text: label.clone(), place: r.place.clone() }, entries));
                }
            }
            "equations" => {
                for (label, e) in self.table(v, "equations") {
                    let e = self.expression(e, label);
                    raw.equations.push((Text { text: label.clone(), place: e.place.clone() }, e));
                }
            }
            "ratio" | "gyrator" => {
                for (gives, r) in self.table(v, key) {
                    let ratio = self.ratio(gives, r, key == "gyrator");
                    raw.ratios.push(ratio);
                }
            }
            "energy" => raw.energy = Some(self.expression(v, key)),
            "loss" => raw.loss = Some(self.expression(v, key)),
            "supply" => raw.supply = Some(self.expression(v, key)),
            "parts" => {
                for (name, p) in self.table(v, "parts") {
                    let part = self.part(name, p);
                    raw.parts.push(part);
                }
            }
            "couplings" => {
                for c in self.list(v, "couplings") {
                    let c = self.coupling(c);
                    raw.couplings.push(c);
                }
            }
            "fixed" => raw.fixed = self.list(v, "fixed").iter().map(|c| self.text(c, "fixed")).collect(),
            "free" => raw.free = self.list(v, "free").iter().map(|c| self.text(c, "free")).collect(),
            "mechanism" => {
                for (name, m) in self.table(v, "mechanism") {
                    let m = self.mechanism(name, m);
                    raw.mechanisms.push(m);
                }
            }
            "observe" => {
                for (name, o) in self.table(v, "observe") {
                    if let Some(o) = self.observe(name, o) {
                        raw.observe.push(o);
                    }
                }
            }
            "start" => raw.start = self.named(v, "start"),
            "run" => {
                for (k, r) in self.table(v, "run") {
                    match k.as_str() {
                        "sample" => raw.sample = Some(self.expression(r, "run.sample")),
                        "method" => raw.method = Some(self.text(r, "run.method")),
                        _ => self.unknown(k, r, "run", &["sample", "method"]),
                    }
                }
            }
            "model" => {
                for (name, m) in self.table(v, "model") {
                    let inner = self.model(m, false);
                    raw.models.push((name.clone(), Rc::new(inner)));
                }
            }
            _ => self.unknown(key, v, "", known),
        }
    }

    fn port(&mut self, name: &str, node: &Node) -> Option<RawPort> {
        if let Some(of) = node.text() {
            return Some(RawPort::Alias { of, inward: false });
        }
        let what = format!("port {name}");
        let (mut across, mut through, mut gives, mut scalar, mut of, mut inward) =
            (None, None, None, false, None, false);
        for (k, v) in self.table(node, &what) {
            match k.as_str() {
                "across" => across = Some(self.text(v, &what)),
                "through" => through = Some(self.text(v, &what)),
                "gives" => gives = Some(self.text(v, &what)),
                "kind" => scalar = self.kind(v, &what),
                "of" => of = Some(self.text(v, &what)),
                "positive" => {
                    let t = self.text(v, &what);
                    inward = t.text == "in";
                    if !["in", "out"].contains(&t.text.as_str()) {
                        self.fail(&v.place, &what, "positive = \"in\" or \"out\"".into());
                    }
                }
                _ => self.unknown(k, v, &what, &["across", "through", "gives", "kind", "of", "positive"]),
            }
        }
        match (across, through, gives, of) {
            (None, None, None, Some(of)) => Some(RawPort::Alias { of, inward }),
            (Some(across), Some(through), Some(gives), None) => {
                Some(RawPort::Own { across, through, gives, scalar, place: node.place.clone() })
            }
            _ => {
                self.fail(
                    &node.place,
                    &what,
                    "a port is { across, through, gives }, or the name of a part's port".into(),
                );
                None
            }
        }
    }

    fn kind(&mut self, v: &Node, what: &str) -> bool {
        let t = self.text(v, what);
        if !["scalar", "vector"].contains(&t.text.as_str()) {
            self.fail(&v.place, what, "kind = \"scalar\" or \"vector\"".into());
        }
        t.text == "scalar"
    }

    fn state(&mut self, name: &str, node: &Node) -> RawState {
        let mut state = RawState { name: name.into(), unit: Text::default(), scalar: false, transport: true };
        if let Some(unit) = node.text() {
            state.unit = unit;
            return state;
        }
        let what = format!("state {name}");
        state.unit = Text { text: "1".into(), place: node.place.clone() };
        for (k, v) in self.table(node, &what) {
            match k.as_str() {
                "unit" => state.unit = self.text(v, &what),
                "kind" => state.scalar = self.kind(v, &what),
                "transport" => state.transport = self.truth(v, &what),
                _ => self.unknown(k, v, &what, &["unit", "kind", "transport"]),
            }
        }
        state
    }

    fn ratio(&mut self, gives: &str, node: &Node, gyrator: bool) -> RawRatio {
        let what = format!("ratio {gives}");
        let mut terms = Vec::new();
        let items: Vec<&Node> = match &node.value {
            Item::List(l) => l.iter().collect(),
            _ => vec![node],
        };
        for item in items {
            let (mut of, mut is) = (None, None);
            for (k, v) in self.table(item, &what) {
                match k.as_str() {
                    "of" => of = Some(self.text(v, &what)),
                    "is" => is = Some(self.expression(v, &what)),
                    _ => self.unknown(k, v, &what, &["of", "is"]),
                }
            }
            match (of, is) {
                (Some(of), Some(is)) => terms.push((of, is)),
                _ => self.fail(&item.place, &what, "a ratio is { of = \"...\", is = ... }".into()),
            }
        }
        RawRatio { gives: Text { text: gives.into(), place: node.place.clone() }, terms, gyrator }
    }

    fn part(&mut self, name: &str, node: &Node) -> RawPart {
        let what = format!("part {name}");
        let mut part = RawPart {
            name: name.into(),
            place: node.place.clone(),
            uses: None,
            along: None,
            turn: Vec::new(),
            matrix: None,
            spin: None,
            set: Vec::new(),
            feed: Vec::new(),
            content: Rc::default(),
        };
        let known: Vec<&str> = PLACING_KEYS.iter().chain(MODEL_KEYS).copied().collect();
        let mut raw = Raw { place: node.place.clone(), ..Raw::default() };
        let mut own = None;
        for (key, v) in self.table(node, &what) {
            match key.as_str() {
                "use" => part.uses = Some(self.text(v, &what)),
                "along" => part.along = Some(self.expression(v, &what)),
                "turn" => part.turn = self.turn(v, &what),
                "matrix" => part.matrix = Some(self.expression(v, &what)),
                "spin" => part.spin = Some(self.expression(v, &what)),
                "set" => part.set = self.named(v, &what),
                "feed" => part.feed = self.named(v, &what),
                "dim" => self.model_key(&mut raw, key, v, &known),
                _ => {
                    own = own.or(Some(v.place.clone()));
                    self.model_key(&mut raw, key, v, &known);
                }
            }
        }
        if let (Some(_), Some(place)) = (&part.uses, own) {
            self.fail(&place, &what, "a part either uses a model or is written here, not both".into());
        }
        let ways = usize::from(part.along.is_some())
            + usize::from(!part.turn.is_empty())
            + usize::from(part.matrix.is_some());
        if ways > 1 {
            self.errors.push(node.place.error(
                Rule::TwoHosts,
                &what,
                "the part is placed twice: give one of along, turn, matrix".to_string(),
            ));
        }
        part.content = Rc::new(raw);
        part
    }

    fn turn(&mut self, node: &Node, what: &str) -> Vec<(char, Text)> {
        let Item::List(steps) = &node.value else {
            return vec![('z', self.expression(node, what))];
        };
        let mut turns = Vec::new();
        for step in steps {
            match &step.value {
                Item::List(pair) if pair.len() == 2 => {
                    let axis = self.text(&pair[0], what).text;
                    if !["x", "y", "z"].contains(&axis.as_str()) {
                        self.fail(&step.place, what, format!("'{axis}' is not an axis; use x, y or z"));
                    }
                    turns.push((axis.chars().next().unwrap_or('z'), self.expression(&pair[1], what)));
                }
                _ => self.fail(
                    &step.place,
                    what,
                    "turn is an angle, or a list of [\"axis\", \"angle\"]".into(),
                ),
            }
        }
        turns
    }

    fn coupling(&mut self, node: &Node) -> RawCoupling {
        let mut c = RawCoupling { place: node.place.clone(), join: Vec::new(), series: false };
        for (k, v) in self.table(node, "coupling") {
            match k.as_str() {
                "join" => {
                    c.place = v.place.clone();
                    c.join = self.list(v, "join").iter().map(|t| self.text(t, "join")).collect();
                }
                "shared" => {
                    let t = self.text(v, "coupling");
                    c.series = t.text == "through";
                    if !["across", "through"].contains(&t.text.as_str()) {
                        self.fail(&v.place, "coupling", "shared = \"across\" or \"through\"".into());
                    }
                }
                _ => self.unknown(k, v, "coupling", &["join", "shared"]),
            }
        }
        if c.join.len() < 2 {
            self.fail(&c.place.clone(), "coupling", "join names at least two ports".into());
        }
        c
    }

    fn mechanism(&mut self, name: &str, node: &Node) -> RawMechanism {
        let what = format!("mechanism {name}");
        let mut m = RawMechanism {
            name: name.into(),
            place: node.place.clone(),
            reads: Vec::new(),
            gives: Vec::new(),
            rule: Vec::new(),
            start: Vec::new(),
            hold: None,
            always: false,
        };
        for (k, v) in self.table(node, &what) {
            match k.as_str() {
                "reads" => m.reads = self.named(v, &what),
                "gives" => m.gives = self.named(v, &what),
                "rule" => m.rule = self.named(v, &what),
                "start" => m.start = self.named(v, &what),
                "hold" => m.hold = Some(self.expression(v, &what)),
                "runs" => {
                    let t = self.text(v, &what);
                    m.always = t.text == "always";
                    if !["always", "each sample"].contains(&t.text.as_str()) {
                        self.fail(&v.place, &what, "runs = \"each sample\" or \"always\"".into());
                    }
                }
                _ => self.unknown(k, v, &what, &["reads", "gives", "rule", "start", "hold", "runs"]),
            }
        }
        m
    }

    fn observe(&mut self, name: &str, node: &Node) -> Option<RawObserve> {
        let what = format!("observe {name}");
        if let Some(of) = node.text() {
            return Some(RawObserve { name: name.into(), of, frame: None });
        }
        let (mut of, mut frame) = (None, None);
        for (k, v) in self.table(node, &what) {
            match k.as_str() {
                "of" => of = Some(self.expression(v, &what)),
                "in" => frame = Some(self.text(v, &what)),
                _ => self.unknown(k, v, &what, &["of", "in"]),
            }
        }
        if of.is_none() {
            self.fail(&node.place, &what, "an observation says of = \"...\"".into());
        }
        Some(RawObserve { name: name.into(), of: of?, frame })
    }

    fn lookup(&mut self, name: &str, node: &Node) -> RawTable {
        let what = format!("table {name}");
        let mut t = RawTable {
            name: name.into(),
            place: node.place.clone(),
            x: None,
            y: None,
            value: None,
            file: None,
            cubic: false,
        };
        for (k, v) in self.table(node, &what) {
            match k.as_str() {
                "x" => t.x = Some(self.expression(v, &what)),
                "y" => t.y = Some(self.expression(v, &what)),
                "value" => t.value = Some(self.expression(v, &what)),
                "file" => t.file = Some(self.text(v, &what)),
                "interpolation" => {
                    let i = self.text(v, &what);
                    t.cubic = i.text == "cubic";
                    if !["linear", "cubic"].contains(&i.text.as_str()) {
                        self.fail(&v.place, &what, "interpolation = \"linear\" or \"cubic\"".into());
                    }
                }
                _ => self.unknown(k, v, &what, &["x", "y", "value", "file", "interpolation"]),
            }
        }
        t
    }
}
