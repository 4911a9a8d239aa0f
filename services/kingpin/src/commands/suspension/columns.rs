//! The columns of a solved row: name and how it is read. One list serves the writing of results and the
//! comparison with a reference.

use super::arguments::SuspensionMethod;
use super::input::{LOADS, SIDES};
use super::solve::Solved;
use config::axle::{Axle, Geometry};
use multibody::methods::{MappedSide, SideForces};
use multibody::{SideOutput, SuspensionOutput};
use spatial::Vector3;

/// A column.
pub struct Column {
    /// Its name in the header.
    pub name: String,
    /// Its value in a row.
    pub read: Box<dyn Fn(&Solved) -> f64>,
}

const AXES: [&str; 3] = ["x", "y", "z"];

/// Variants of a multibody solution by column suffix, as [`super::solve::Solver`] solves them.
pub fn variants(axle: &Axle) -> &'static [&'static str] {
    if axle.stabiliser.is_some() { &["_arb", "_noarb"] } else { &[""] }
}

fn multibody(method: SuspensionMethod) -> bool {
    matches!(method, SuspensionMethod::Multibody | SuspensionMethod::All)
}

struct List(Vec<Column>);

impl List {
    fn add(&mut self, name: impl Into<String>, read: impl Fn(&Solved) -> f64 + 'static) {
        self.0.push(Column { name: name.into(), read: Box::new(read) });
    }

    /// A number of one side of a variant.
    fn side(&mut self, name: &str, variant: usize, k: usize, read: impl Fn(&SideOutput) -> f64 + 'static) {
        self.add(format!("{name}_{}", SIDES[k]), move |row| read(&row.variants[variant].side[k]));
    }

    /// A vector of one side of a variant; `suffix` stands between axis and side.
    fn vector(
        &mut self,
        name: &str,
        suffix: &str,
        variant: usize,
        k: usize,
        read: impl Fn(&SideOutput) -> Vector3<f64> + Copy + 'static,
    ) {
        for (c, axis) in AXES.iter().enumerate() {
            self.side(&format!("{name}_{axis}{suffix}"), variant, k, move |side| read(side)[c]);
        }
    }
}

/// All columns of a method but the status. `design`: the solved pose at design.
pub fn columns(axle: &Axle, method: SuspensionMethod, design: &SuspensionOutput) -> Vec<Column> {
    let mut list = List(Vec::new());
    list.add("step", |row| row.step);
    list.add("rack", |row| row.input.rack_m);
    list.add("zL", |row| row.input.wheel_height_m[0]);
    list.add("zR", |row| row.input.wheel_height_m[1]);
    if multibody(method) {
        for k in 0..2 {
            kinematic(&mut list, axle, k);
        }
    }
    for k in 0..2 {
        for (c, load) in LOADS.iter().enumerate() {
            list.add(format!("{load}_{}", SIDES[k]), move |row| {
                let (force, moment) = (&row.input.wheel_force_n[k], &row.input.wheel_moment_n_m[k]);
                if c < 3 { force[c] } else { moment[c - 3] }
            });
        }
        if multibody(method) {
            for c in 0..3 {
                list.side(&format!("F{}b", AXES[c]), 0, k, move |side| side.wheel_force_n[c]);
            }
            for c in 0..3 {
                list.side(&format!("M{}b", AXES[c]), 0, k, move |side| side.wheel_moment_n_m[c]);
            }
        }
    }
    if multibody(method) {
        for (variant, suffix) in variants(axle).iter().enumerate() {
            forces(&mut list, axle, variant, suffix);
        }
        if axle.bushings.is_some() {
            compliance(&mut list, axle, design);
        }
    }
    if matches!(method, SuspensionMethod::Map | SuspensionMethod::All) {
        mapped(&mut list);
        older(&mut list, "map", |side| side.map_n, |row| row.older.map_rack_n);
    }
    if matches!(method, SuspensionMethod::MapThesis | SuspensionMethod::All) {
        older(&mut list, "map_thesis", |side| side.map_thesis_n, |row| row.older.map_thesis_rack_n);
    }
    if matches!(method, SuspensionMethod::Simple | SuspensionMethod::All) {
        older(&mut list, "simple", |side| side.simple_n, |row| row.older.simple_rack_n);
    }
    list.0
}

fn kinematic(list: &mut List, axle: &Axle, k: usize) {
    let strut = matches!(axle.geometry, Geometry::Strut(_));
    list.vector("lbj", "", 0, k, |side| side.lower_joint_m);
    if !strut {
        list.vector("ubj", "", 0, k, |side| side.upper_joint_m);
    }
    list.vector("to", "", 0, k, |side| side.tie_rod_ball_m);
    list.vector("wc", "", 0, k, |side| side.wheel_centre_m);
    list.vector("cp", "", 0, k, |side| side.contact_patch_m);
    for c in 0..4 {
        list.side(&format!("q{c}"), 0, k, move |side| side.knuckle_quaternion[c]);
    }
    list.side("steer", 0, k, |side| side.steer_rad);
    list.side("toe", 0, k, |side| side.toe_rad);
    list.side("camber", 0, k, |side| side.camber_rad);
    list.side("caster", 0, k, |side| side.caster_rad);
    list.side("kpi", 0, k, |side| side.kingpin_inclination_rad);
    list.side(if strut { "strut_length" } else { "spring_length" }, 0, k, |side| side.spring_length_m);
    if axle.stabiliser.is_some() {
        list.add(format!("arb_angle_{}", SIDES[k]), move |row| row.variants[0].stabiliser_angle_rad[k]);
    }
}

fn forces(list: &mut List, axle: &Axle, variant: usize, suffix: &str) {
    let upper = if matches!(axle.geometry, Geometry::Strut(_)) { "Ftop" } else { "Fubj" };
    let bar = axle.stabiliser.is_some() && variant == 0;
    for k in 0..2 {
        list.side(&format!("tie{suffix}"), variant, k, |side| side.tie_rod_force_n);
        list.side(&format!("spring{suffix}"), variant, k, |side| side.spring_force_n);
        list.vector(upper, suffix, variant, k, |side| side.upper_joint_force_n);
        list.vector("Flbj", suffix, variant, k, |side| side.lower_joint_force_n);
        if bar {
            list.side("droplink", variant, k, |side| side.drop_link_force_n);
        }
    }
    list.add(format!("rack_force{suffix}"), move |row| row.variants[variant].rack_force_n);
    if bar {
        list.add("arb_torque", |row| row.variants[0].stabiliser_torque_n_m);
    }
}

fn compliance(list: &mut List, axle: &Axle, design: &SuspensionOutput) {
    for k in 0..2 {
        let (toe, camber) = (design.side[k].toe_rad, design.side[k].camber_rad);
        list.side("dtoe", 0, k, move |side| side.toe_rad - toe);
        list.side("dcamber", 0, k, move |side| side.camber_rad - camber);
        for (place, point) in axle.geometry.body_points().iter().enumerate() {
            if axle.bushings.as_ref().is_some_and(|b| b.contains_key(*point)) {
                list.vector(&format!("defl_{point}"), "", 0, k, move |side| side.bushing_deflection_m[place]);
            }
        }
    }
}

fn older(
    list: &mut List,
    name: &str,
    side: impl Fn(&SideForces) -> f64 + Copy + 'static,
    rack: impl Fn(&Solved) -> f64 + 'static,
) {
    for k in 0..2 {
        list.add(format!("tie_{name}_{}", SIDES[k]), move |row| side(&row.older.side[k]));
    }
    list.add(format!("rack_force_{name}"), rack);
}

/// Pose and alignment as the maps have them.
fn mapped(list: &mut List) {
    type Read = fn(&MappedSide) -> f64;
    let read: [(&str, Read); 4] = [
        ("toe", |side| side.toe_rad),
        ("camber", |side| side.camber_rad),
        ("caster", |side| side.caster_rad),
        ("kpi", |side| side.kingpin_inclination_rad),
    ];
    type Point = fn(&MappedSide) -> Vector3<f64>;
    let points: [(&str, Point); 3] = [
        ("lbj", |side| side.kingpin_point_m),
        ("to", |side| side.tie_rod_ball_m),
        ("wc", |side| side.wheel_centre_m),
    ];
    let value = |row: &Solved, k: usize, read: Read| row.mapped.as_ref().map_or(0.0, |m| read(&m[k]));
    for k in 0..2 {
        for (name, read) in read {
            list.add(format!("{name}_map_{}", SIDES[k]), move |row| value(row, k, read));
        }
        for (name, point) in points {
            for (c, axis) in AXES.iter().enumerate() {
                list.add(format!("{name}_{axis}_map_{}", SIDES[k]), move |row| {
                    row.mapped.as_ref().map_or(0.0, |m| point(&m[k])[c])
                });
            }
        }
    }
}
