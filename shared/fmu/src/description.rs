//! `modelDescription.xml` of FMI 2.0 (§2.2) and 3.0 (§2.4): what a co-simulation master needs of it.

use crate::FmuError;
use crate::units::Unit;
use roxmltree::{Document, Node};
use std::collections::BTreeMap;

/// Most variables that are looked at.
const VARIABLES_MAX: usize = 1_000_000;

/// Version of the interface.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
pub enum Version {
    /// 2.0.x.
    Two,
    /// 3.0.x.
    Three,
}

impl std::fmt::Display for Version {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Version::Two => "2.0",
            Version::Three => "3.0",
        })
    }
}

/// Type of a variable, FMI 3.0's names. FMI 2.0's Real, Integer and Enumeration are Float64 and Int32.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, serde::Deserialize)]
#[allow(missing_docs)]
pub enum Kind {
    Float64,
    Float32,
    Int8,
    UInt8,
    Int16,
    UInt16,
    Int32,
    UInt32,
    Int64,
    UInt64,
    Boolean,
    String,
    Binary,
    Clock,
}

impl Kind {
    /// Whether its values go through an `f64` of the table.
    #[must_use]
    pub fn numeric(self) -> bool {
        !matches!(self, Kind::String | Kind::Binary | Kind::Clock)
    }
}

/// What a variable is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[allow(missing_docs)]
pub enum Causality {
    Parameter,
    StructuralParameter,
    CalculatedParameter,
    Input,
    Output,
    Local,
    Independent,
}

impl Causality {
    /// As FMI writes it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Parameter => "parameter",
            Self::StructuralParameter => "structuralParameter",
            Self::CalculatedParameter => "calculatedParameter",
            Self::Input => "input",
            Self::Output => "output",
            Self::Local => "local",
            Self::Independent => "independent",
        }
    }
}

/// A variable.
#[derive(Debug, Clone, PartialEq)]
pub struct Variable {
    /// Name.
    pub name: String,
    /// Handle.
    pub reference: u32,
    /// Type.
    pub kind: Kind,
    /// What it is for.
    pub causality: Causality,
    /// `constant`, `fixed`, `tunable`, `discrete`, `continuous`.
    pub variability: String,
    /// How it gets its start value: `exact`, `approx`, `calculated`.
    pub initial: Option<String>,
    /// Name of its unit.
    pub unit: Option<String>,
    /// Start value as written.
    pub start: Option<String>,
    /// Least value, in its unit.
    pub min: Option<f64>,
    /// Greatest value, in its unit.
    pub max: Option<f64>,
    /// What it is.
    pub description: String,
    /// Whether it is an array (FMI 3.0).
    pub array: bool,
}

/// What an FMU says of itself.
#[derive(Debug, Clone, PartialEq)]
pub struct Description {
    /// Version of the interface.
    pub version: Version,
    /// Name of the model.
    pub model_name: String,
    /// What it is.
    pub description: String,
    /// File name of the binary.
    pub model_identifier: String,
    /// `guid` (2.0) or `instantiationToken` (3.0).
    pub token: String,
    /// Tool that made it.
    pub generation_tool: String,
    /// Only a wrapper around a tool.
    pub needs_execution_tool: bool,
    /// Steps of any length.
    pub variable_step: bool,
    /// Only steps of this length and its multiples. [s]
    pub fixed_step_s: Option<f64>,
    /// Units by name; `None`: named without a meaning.
    pub units: BTreeMap<String, Option<Unit>>,
    /// Variables in the order of the file.
    pub variables: Vec<Variable>,
}

fn xml(why: impl Into<String>) -> FmuError {
    FmuError::Xml { why: why.into() }
}

impl Description {
    /// Reads the text of a `modelDescription.xml`.
    ///
    /// # Errors
    /// [`FmuError::Xml`], [`FmuError::Version`], [`FmuError::NotCoSimulation`].
    pub fn parse(text: &str) -> Result<Self, FmuError> {
        let document =
            Document::parse(text.trim_start_matches('\u{feff}')).map_err(|e| xml(e.to_string()))?;
        let root = document.root_element();
        if root.tag_name().name() != "fmiModelDescription" {
            return Err(xml(format!(
                "its root is <{}>, must be <fmiModelDescription>",
                root.tag_name().name()
            )));
        }
        let found = root.attribute("fmiVersion").unwrap_or_default();
        let version = match found {
            "2.0" => Version::Two,
            _ if found.starts_with("3.0") => Version::Three,
            _ => return Err(FmuError::Version { found: found.to_owned() }),
        };
        let must = |node: Node<'_, '_>, name: &str| {
            node.attribute(name).map(str::to_owned).ok_or_else(|| {
                let line = document.text_pos_at(node.range().start).row;
                xml(format!("line {line}: <{}> lacks {name}", node.tag_name().name()))
            })
        };
        let slave = child(root, "CoSimulation").ok_or(FmuError::NotCoSimulation)?;
        let token = if version == Version::Two { "guid" } else { "instantiationToken" };
        let flag = |name| slave.attribute(name).is_some_and(|value| value == "true" || value == "1");
        let model_identifier = must(slave, "modelIdentifier")?;
        if model_identifier.is_empty()
            || !model_identifier.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
        {
            return Err(xml(format!(
                "modelIdentifier = \"{model_identifier}\": must be a name of the C language"
            )));
        }
        let mut description = Description {
            version,
            model_name: must(root, "modelName")?,
            description: root.attribute("description").unwrap_or_default().to_owned(),
            model_identifier,
            token: must(root, token)?,
            generation_tool: root.attribute("generationTool").unwrap_or_default().to_owned(),
            needs_execution_tool: flag("needsExecutionTool"),
            variable_step: flag("canHandleVariableCommunicationStepSize"),
            fixed_step_s: slave.attribute("fixedInternalStepSize").and_then(|v| v.trim().parse().ok()),
            units: units(root),
            variables: Vec::new(),
        };
        let types = types(root);
        let Some(variables) = child(root, "ModelVariables") else {
            return Err(xml("<ModelVariables> is missing"));
        };
        for node in variables.children().filter(Node::is_element).take(VARIABLES_MAX) {
            let (tag, detail) = match version {
                Version::Two => {
                    let detail = node.children().find(|n| {
                        n.is_element()
                            && ["Real", "Integer", "Boolean", "String", "Enumeration"]
                                .contains(&n.tag_name().name())
                    });
                    let name = node.attribute("name").unwrap_or_default();
                    let detail = detail.ok_or_else(|| xml(format!("variable {name} has no type")))?;
                    (detail.tag_name().name(), detail)
                }
                Version::Three => (node.tag_name().name(), node),
            };
            let name = must(node, "name")?;
            let reference = must(node, "valueReference")?;
            let reference =
                reference.trim().parse().map_err(|_| xml(format!("{name}: valueReference = {reference}")))?;
            let kind = kind_of(tag, version).ok_or_else(|| xml(format!("{name}: unknown type <{tag}>")))?;
            let causality = match node.attribute("causality").unwrap_or("local") {
                "parameter" => Causality::Parameter,
                "structuralParameter" => Causality::StructuralParameter,
                "calculatedParameter" => Causality::CalculatedParameter,
                "input" => Causality::Input,
                "output" => Causality::Output,
                "independent" => Causality::Independent,
                "local" => Causality::Local,
                other => return Err(xml(format!("{name}: causality = \"{other}\""))),
            };
            let declared = detail.attribute("declaredType").and_then(|name| types.get(name));
            let number = |key| detail.attribute(key).and_then(|v: &str| v.trim().parse().ok());
            let start = detail.attribute("start").map(str::to_owned);
            let start = start.or_else(|| {
                let first = node.children().find(|n| n.tag_name().name() == "Start")?;
                first.attribute("value").map(str::to_owned)
            });
            description.variables.push(Variable {
                reference,
                kind,
                causality,
                variability: node.attribute("variability").unwrap_or("continuous").to_owned(),
                initial: node.attribute("initial").map(str::to_owned),
                unit: detail
                    .attribute("unit")
                    .map(str::to_owned)
                    .or_else(|| declared.and_then(|declared| declared.unit.clone())),
                start,
                min: number("min").or_else(|| declared.and_then(|declared| declared.min)),
                max: number("max").or_else(|| declared.and_then(|declared| declared.max)),
                description: node.attribute("description").unwrap_or_default().to_owned(),
                array: node.children().any(|n| n.tag_name().name() == "Dimension"),
                name,
            });
        }
        Ok(description)
    }

    /// The variable of a name.
    ///
    /// # Errors
    /// [`FmuError::UnknownVariable`] with the closest one that there is.
    pub fn variable(&self, name: &str) -> Result<&Variable, FmuError> {
        self.variables.iter().find(|v| v.name == name).ok_or_else(|| {
            let closeness = |v: &&Variable| (strsim::jaro_winkler(&v.name, name) * 1e6) as u64;
            let near = self.variables.iter().max_by_key(closeness);
            let near = near.filter(|v| strsim::jaro_winkler(&v.name, name) > 0.8).map(|v| v.name.clone());
            FmuError::UnknownVariable { name: name.to_owned(), near }
        })
    }

    /// Meaning of a unit's name: the FMU's own word for it, else the symbols of [`Unit::parse`].
    #[must_use]
    pub fn unit(&self, name: &str) -> Option<Unit> {
        self.units.get(name).copied().flatten().or_else(|| Unit::parse(name))
    }
}

fn child<'a, 'i>(node: Node<'a, 'i>, name: &str) -> Option<Node<'a, 'i>> {
    node.children().find(|n| n.tag_name().name() == name)
}

fn units(root: Node<'_, '_>) -> BTreeMap<String, Option<Unit>> {
    let all = child(root, "UnitDefinitions").into_iter().flat_map(|n| n.children());
    all.filter(|n| n.tag_name().name() == "Unit")
        .filter_map(|node| {
            let name = node.attribute("name")?.to_owned();
            let unit = child(node, "BaseUnit").map(|base| {
                let whole = |key| base.attribute(key).and_then(|v: &str| v.trim().parse().ok()).unwrap_or(0);
                let number = |key, absent| {
                    base.attribute(key).and_then(|v: &str| v.trim().parse().ok()).unwrap_or(absent)
                };
                Unit {
                    exponents: ["kg", "m", "s", "A", "K", "mol", "cd"].map(whole),
                    factor: number("factor", 1.0),
                    offset: number("offset", 0.0),
                }
            });
            // A factor of zero would make every value infinite.
            Some((name, unit.filter(|u| u.factor.is_finite() && u.factor != 0.0 && u.offset.is_finite())))
        })
        .collect()
}

struct Declared {
    unit: Option<String>,
    min: Option<f64>,
    max: Option<f64>,
}

fn types(root: Node<'_, '_>) -> BTreeMap<String, Declared> {
    let all = child(root, "TypeDefinitions").into_iter().flat_map(|n| n.children());
    all.filter(Node::is_element)
        .filter_map(|node| {
            // 2.0: <SimpleType name><Real unit/></SimpleType>; 3.0: <Float64Type name unit/>.
            let detail = node.children().find(Node::is_element).unwrap_or(node);
            let detail = if node.tag_name().name() == "SimpleType" { detail } else { node };
            let number = |key| detail.attribute(key).and_then(|v: &str| v.trim().parse().ok());
            Some((
                node.attribute("name")?.to_owned(),
                Declared {
                    unit: detail.attribute("unit").map(str::to_owned),
                    min: number("min"),
                    max: number("max"),
                },
            ))
        })
        .collect()
}

fn kind_of(tag: &str, version: Version) -> Option<Kind> {
    Some(match tag {
        "Enumeration" if version == Version::Three => Kind::Int64,
        "Real" | "Float64" => Kind::Float64,
        "Float32" => Kind::Float32,
        "Int8" => Kind::Int8,
        "UInt8" => Kind::UInt8,
        "Int16" => Kind::Int16,
        "UInt16" => Kind::UInt16,
        "Integer" | "Enumeration" | "Int32" => Kind::Int32,
        "UInt32" => Kind::UInt32,
        "Int64" => Kind::Int64,
        "UInt64" => Kind::UInt64,
        "Boolean" => Kind::Boolean,
        "String" => Kind::String,
        "Binary" => Kind::Binary,
        "Clock" => Kind::Clock,
        _ => return None,
    })
}
