//! What a region's layout is made of, and the one macro that states it.
//!
//! One list makes the table: from the same lines come the `repr(C)` struct, the layout hash that guards
//! attaching, the columns of log and export, the ROS 2 message definition and the manual. All fields are
//! 8-byte numbers or arrays of them, so that a log record is the struct's bytes behind a 4-byte CDR header.

/// What a word of a field holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// IEEE 754 double, NaN where the value is absent.
    F64,
    /// Unsigned counter, code or bit set.
    U64,
}

/// How the entries of an array field are told apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Axis {
    /// A single number.
    One,
    /// `left`, `right`.
    Side,
    /// `fl`, `fr`, `rl`, `rr`.
    Wheel,
    /// `x`, `y`, `z`.
    Xyz,
    /// `w`, `x`, `y`, `z` of a unit quaternion, scalar first.
    Quaternion,
    /// Left x, y, z, then right x, y, z.
    SideXyz,
    /// Left w, x, y, z, then right.
    SideQuaternion,
    /// Front left x, y, z, then fr, rl, rr.
    WheelXyz,
    /// `rig`, `vehicle`, `multibody`, `logger`.
    Service,
    /// Numbered from 0.
    Index,
}

const SIDE: [&str; 2] = ["left", "right"];
const WHEEL: [&str; 4] = ["fl", "fr", "rl", "rr"];
const XYZ: [&str; 3] = ["x", "y", "z"];
const WXYZ: [&str; 4] = ["w", "x", "y", "z"];
const SERVICE: [&str; 4] = ["rig", "vehicle", "multibody", "logger"];

impl Axis {
    /// The label of entry `index`, empty for a single number.
    pub fn label(self, index: usize) -> String {
        match self {
            Axis::One => String::new(),
            Axis::Side => SIDE[index].to_owned(),
            Axis::Wheel => WHEEL[index].to_owned(),
            Axis::Xyz => XYZ[index].to_owned(),
            Axis::Quaternion => WXYZ[index].to_owned(),
            Axis::SideXyz => format!("{}_{}", SIDE[index / 3], XYZ[index % 3]),
            Axis::SideQuaternion => format!("{}_{}", SIDE[index / 4], WXYZ[index % 4]),
            Axis::WheelXyz => format!("{}_{}", WHEEL[index / 3], XYZ[index % 3]),
            Axis::Service => SERVICE[index].to_owned(),
            Axis::Index => index.to_string(),
        }
    }
}

/// One field of a region.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Field {
    /// Name, with its unit as suffix where it has one.
    pub name: &'static str,
    /// What its words hold.
    pub kind: Kind,
    /// Number of words.
    pub len: usize,
    /// Meaning of the entries.
    pub axis: Axis,
    /// Unit symbol, `1` for counters, codes and ratios.
    pub unit: &'static str,
    /// One-line description.
    pub doc: &'static str,
}

/// A region's layout: which words mean what. The same layout may serve several regions.
#[derive(Debug, Clone, Copy)]
pub struct Layout {
    /// Name of the message type.
    pub name: &'static str,
    /// Raised with every change of meaning that the hash cannot see.
    pub version: u32,
    /// All fields in memory order.
    pub fields: &'static [Field],
    /// One-line description.
    pub doc: &'static str,
}

/// One word of a region as a column of a log.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// `field` or `field.label`.
    pub name: String,
    /// Word offset in the payload.
    pub word: usize,
    /// What the word holds.
    pub kind: Kind,
    /// Unit symbol.
    pub unit: &'static str,
    /// Description.
    pub doc: &'static str,
}

impl Layout {
    /// Payload length in 8-byte words.
    pub const fn words(&self) -> usize {
        let mut sum = 0;
        let mut i = 0;
        while i < self.fields.len() {
            sum += self.fields[i].len;
            i += 1;
        }
        sum
    }

    /// FNV-1a over version, names, kinds, lengths and units in order: equal only for the same layout.
    pub const fn hash(&self) -> u64 {
        let mut h = fnv(0xcbf2_9ce4_8422_2325, self.name.as_bytes());
        h = fnv(h, &self.version.to_le_bytes());
        let mut i = 0;
        while i < self.fields.len() {
            let f = &self.fields[i];
            h = fnv(h, f.name.as_bytes());
            h = fnv(h, &[0xff, f.kind as u8]);
            h = fnv(h, &(f.len as u64).to_le_bytes());
            h = fnv(h, f.unit.as_bytes());
            i += 1;
        }
        h
    }

    /// Every word as a named column, in memory order.
    pub fn columns(&self) -> Vec<Column> {
        let mut word = 0;
        let mut columns = Vec::with_capacity(self.words());
        for f in self.fields {
            for i in 0..f.len {
                let label = f.axis.label(i);
                let name = if label.is_empty() { f.name.to_owned() } else { format!("{}.{label}", f.name) };
                columns.push(Column { name, word: word + i, kind: f.kind, unit: f.unit, doc: f.doc });
            }
            word += f.len;
        }
        columns
    }

    /// The layout as a ROS 2 message definition; plain CDR of it is the struct's bytes.
    pub fn ros2_message(&self) -> String {
        let mut text = format!("# {}\n", self.doc);
        for f in self.fields {
            let kind = match f.kind {
                Kind::F64 => "float64",
                Kind::U64 => "uint64",
            };
            let array = if matches!(f.axis, Axis::One) { String::new() } else { format!("[{}]", f.len) };
            text += &format!("{kind}{array} {} # [{}] {}\n", f.name, f.unit, f.doc);
        }
        text
    }
}

const fn fnv(mut h: u64, bytes: &[u8]) -> u64 {
    let mut i = 0;
    while i < bytes.len() {
        h = (h ^ bytes[i] as u64).wrapping_mul(0x0000_0100_0000_01b3);
        i += 1;
    }
    h
}

/// A struct that is a region's payload.
pub trait Payload: bytemuck::Pod {
    /// Its layout.
    const LAYOUT: Layout;

    /// A payload that says nothing: NaN for every number, 0 for every counter.
    fn absent() -> Self {
        let mut value = Self::zeroed();
        let words: &mut [u64] = bytemuck::cast_slice_mut(std::slice::from_mut(&mut value));
        let mut word = 0;
        for f in Self::LAYOUT.fields {
            if f.kind == Kind::F64 {
                words[word..word + f.len].fill(f64::NAN.to_bits());
            }
            word += f.len;
        }
        value
    }

    /// The payload as words of the table.
    fn words(&self) -> &[u64] {
        bytemuck::cast_slice(std::slice::from_ref(self))
    }

    /// The payload as words of the table, to be read into.
    fn words_mut(&mut self) -> &mut [u64] {
        bytemuck::cast_slice_mut(std::slice::from_mut(self))
    }
}

/// States a payload once: `field: type | Axis | "unit"`, each with its doc comment.
macro_rules! payload {
    (@kind f64) => { $crate::layout::Kind::F64 };
    (@kind u64) => { $crate::layout::Kind::U64 };
    (@type $kind:ident One) => { $kind };
    (@type $kind:ident Side) => { [$kind; 2] };
    (@type $kind:ident Wheel) => { [$kind; 4] };
    (@type $kind:ident Xyz) => { [$kind; 3] };
    (@type $kind:ident Quaternion) => { [$kind; 4] };
    (@type $kind:ident SideXyz) => { [$kind; 6] };
    (@type $kind:ident SideQuaternion) => { [$kind; 8] };
    (@type $kind:ident WheelXyz) => { [$kind; 12] };
    (@type $kind:ident Service) => { [$kind; 4] };
    (@type $kind:ident Index($n:literal)) => { [$kind; $n] };
    (
        #[doc = $doc:literal]
        $name:ident version $version:literal {
            $( #[doc = $fdoc:literal] $field:ident : $kind:ident $axis:ident $(($n:literal))? $unit:literal, )+
        }
    ) => {
        #[doc = $doc]
        #[repr(C)]
        #[derive(Debug, Clone, Copy, PartialEq, bytemuck::Pod, bytemuck::Zeroable)]
        pub struct $name {
            $( #[doc = concat!($fdoc, " [", $unit, "]")] pub $field: payload!(@type $kind $axis $(($n))?), )+
        }

        impl $crate::layout::Payload for $name {
            const LAYOUT: $crate::layout::Layout = $crate::layout::Layout {
                name: stringify!($name),
                version: $version,
                doc: $doc.trim_ascii(),
                fields: &[ $( $crate::layout::Field {
                    name: stringify!($field),
                    kind: payload!(@kind $kind),
                    len: size_of::<payload!(@type $kind $axis $(($n))?)>() / 8,
                    axis: $crate::layout::Axis::$axis,
                    unit: $unit,
                    doc: $fdoc.trim_ascii(),
                }, )+ ],
            };
        }

        const _: () = assert!(size_of::<$name>() == 8 * <$name as $crate::layout::Payload>::LAYOUT.words());
        const _: () = assert!(align_of::<$name>() == 8);
    };
}
pub(crate) use payload;
