//! Suspensions with rubber bushings: the arms are bodies, held by bushings where the axle names them and
//! by ball joints where it does not; arms without any bushing stay as in the rigid model. One stage: poses
//! and forces are found together, the wheel height being given and the spring's force unknown (or, for
//! bench-like checks, the spring locked at a length).

use config::axle::{Axle, Bushing, Geometry, Link, StrutReactionLine};
use spatial::{Matrix3, Vector3, triad_along};

use super::assemble::{Points, base, cross_joint, degenerate};
use super::model::{BODY, Bar, Builder, RACK, Side, SteeringAxis};
use crate::constraint::Kind;
use crate::equilibrium::{BushingElement, Carrier, TorsionElement};
use crate::failure::AssemblyError;

/// The compliant model as data.
#[derive(Debug, Clone)]
pub(crate) struct CompliantModel {
    pub builder: Builder,
    pub sides: [Side; 2],
    pub bar: Option<Bar>,
    pub bushings: Vec<BushingElement>,
    /// Name of each bushing, its side, and its place in the geometry's list of body points.
    pub bushing_names: Vec<(String, usize, usize)>,
    pub torsion: Option<TorsionElement>,
    pub carriers: Vec<Carrier>,
}

/// An arm or link under construction: its inner points and the ball on the knuckle.
struct Arm<'a> {
    what: &'a str,
    inner: &'a [&'a str],
    ball: Vector3<f64>,
    /// A body even without bushings, because the spring stands on it.
    carries: bool,
}

struct Compliant<'a> {
    axle: &'a Axle,
    b: Builder,
    bushings: Vec<BushingElement>,
    names: Vec<(String, usize, usize)>,
}

/// Composes the compliant model of an axle that has bushings.
pub(crate) fn assemble_compliant(axle: &Axle) -> Result<CompliantModel, AssemblyError> {
    let sides = [0, 1].map(|side| Points { geometry: &axle.geometry, side });
    let mut b = base(&sides)?;
    let knuckles = [0, 1].map(|side| b.body(&sides[side].name("knuckle"), sides[side].at("wheel_centre")));
    let mut all = Compliant { axle, b, bushings: Vec::new(), names: Vec::new() };
    let mut built = Vec::with_capacity(2);
    for points in &sides {
        built.push(all.side(points, knuckles[points.side])?);
    }
    let mut torsion = None;
    let mut bar = None;
    if let Some(stabiliser) = &axle.stabiliser {
        let halves = stabiliser.sides();
        let axis = Vector3::from(halves[0].arb_bush_m) - Vector3::from(halves[1].arb_bush_m);
        let axes = triad_along(&axis).ok_or_else(|| degenerate("the stabiliser"))?;
        let mut bodies = [0; 2];
        for (side, half) in halves.iter().enumerate() {
            let bush = Vector3::from(half.arb_bush_m);
            let body = all.b.body(&sides[side].name("bar half"), bush);
            bodies[side] = body;
            let (on_i, on_j) = (all.b.frame(BODY, bush, &axes), all.b.frame(body, bush, &axes));
            all.b.constrain(sides[side].name("bar bush"), BODY, body, Kind::Revolute { on_i, on_j });
            let (end, upper) = (Vector3::from(half.arb_arm_end_m), Vector3::from(half.droplink_upper_m));
            let link = all.b.link(sides[side].name("drop link"), body, end, knuckles[side], upper);
            built[side].drop_link = Some(link);
        }
        let axis: Vector3<f64> = axes.column(2).into_owned();
        let stiffness = stabiliser.stiffness_n_m_per_rad;
        torsion = Some(TorsionElement { bodies, axis, stiffness });
        bar = Some(Bar { axis, stiffness, kinematic: bodies, reaction: bodies });
    }
    let carriers = (0..2)
        .map(|side| {
            let kind = Kind::AxisDriver { s_j: Vector3::zeros(), axis: 2, driver: 1 + side };
            let knuckle = knuckles[side];
            let driver = all.b.constrain(sides[side].name("wheel height"), knuckle, knuckle, kind);
            Carrier { link: built[side].spring, driver }
        })
        .collect();
    let Ok(sides) = <[Side; 2]>::try_from(built) else {
        return Err(degenerate("an axle of other than two sides"));
    };
    let Compliant { b, bushings, names, .. } = all;
    Ok(CompliantModel { builder: b, sides, bar, bushings, bushing_names: names, torsion, carriers })
}

impl Compliant<'_> {
    fn side(&mut self, points: &Points, knuckle: usize) -> Result<Side, AssemblyError> {
        let at = |name: &str| points.at(name);
        let (mut upper, mut lower) = (Vec::new(), Vec::new());
        let (spring, spring_ends, steering_axis);
        match &self.axle.geometry {
            Geometry::DoubleWishbone(_) => {
                let (inner_u, inner_l) = (["uca_front", "uca_rear"], ["lca_front", "lca_rear"]);
                let arm = Arm { what: "upper arm", inner: &inner_u, ball: at("uca_ball"), carries: false };
                upper = self.arm(points, knuckle, &arm)?.1;
                let arm = Arm { what: "lower arm", inner: &inner_l, ball: at("lca_ball"), carries: true };
                let (body, joints) = self.arm(points, knuckle, &arm)?;
                lower = joints;
                let (top, seat) = (at("spring_upper"), at("spring_lower"));
                spring = self.b.link(points.name("spring"), BODY, top, body, seat);
                spring_ends = [(BODY, top), (body, self.b.local(body, seat))];
                steering_axis = SteeringAxis::Points {
                    lower: (knuckle, self.b.local(knuckle, at("lca_ball"))),
                    upper: (knuckle, self.b.local(knuckle, at("uca_ball"))),
                };
            }
            Geometry::Strut(strut) => {
                let (top, low, ball) = (at("strut_top"), at("strut_lower"), at("lca_ball"));
                let axes = triad_along(&(top - low)).ok_or_else(|| degenerate("the strut"))?;
                let kind = Kind::Strut { on_i: self.b.frame(knuckle, low, &axes), s_j: top };
                upper.push(self.b.constrain(points.name("strut"), knuckle, BODY, kind));
                let inner = ["lca_front", "lca_rear"];
                let arm = Arm { what: "lower arm", inner: &inner, ball, carries: false };
                lower = self.arm(points, knuckle, &arm)?.1;
                let seat = match strut.reaction_line {
                    StrutReactionLine::LowerBallToTop => ball,
                    StrutReactionLine::StrutAxis => low,
                };
                spring = self.b.link(points.name("spring"), BODY, top, knuckle, seat);
                upper.push(spring);
                spring_ends = [(BODY, top), (knuckle, self.b.local(knuckle, low))];
                let lower_end = (knuckle, self.b.local(knuckle, ball));
                steering_axis = SteeringAxis::Points { lower: lower_end, upper: (BODY, top) };
            }
            Geometry::FiveLink(five) => {
                let mut carrier = BODY;
                for link in Link::ALL {
                    let (inner, outer) = (format!("{}_inner", link.name()), format!("{}_outer", link.name()));
                    let what = link.name().replace('_', " ") + " link";
                    let carries = link == five.spring_on;
                    let arm = Arm { what: &what, inner: &[&inner], ball: at(&outer), carries };
                    let (body, joints) = self.arm(points, knuckle, &arm)?;
                    if carries {
                        carrier = body;
                    }
                    match link {
                        Link::UpperFront | Link::UpperRear => upper.extend(joints),
                        Link::LowerFront | Link::LowerRear => lower.extend(joints),
                    }
                }
                let (top, seat) = (at("spring_upper"), at("spring_lower"));
                spring = self.b.link(points.name("spring"), BODY, top, carrier, seat);
                spring_ends = [(BODY, top), (carrier, self.b.local(carrier, seat))];
                steering_axis = SteeringAxis::Instantaneous;
            }
        }
        let outer = at("tierod_outer");
        let tie_rod = self.b.link(points.name("tie rod"), RACK, at("tierod_inner"), knuckle, outer);
        let centre = at("wheel_centre");
        Ok(Side {
            knuckle,
            tie_rod_outer: outer - centre,
            contact_patch: at("contact_patch") - centre,
            spin_axis: Vector3::from(self.axle.spin_axis(points.side)),
            wheel_centre_z: centre.z,
            steering_axis,
            tie_rod,
            spring,
            drop_link: None,
            upper,
            lower,
            spring_ends,
        })
    }

    /// The arm's body (the car body where it needs none) and its joints to the knuckle.
    fn arm(
        &mut self,
        points: &Points,
        knuckle: usize,
        arm: &Arm,
    ) -> Result<(usize, Vec<usize>), AssemblyError> {
        let soft = self.axle.bushings.clone().unwrap_or_default();
        let Arm { what, inner, ball, carries } = *arm;
        if !carries && !inner.iter().any(|name| soft.contains_key(*name)) {
            let leg = |name: &str| if inner.len() == 1 { what.to_owned() } else { format!("{what}, {name}") };
            let legs = inner
                .iter()
                .map(|name| self.b.link(points.name(&leg(name)), BODY, points.at(name), knuckle, ball))
                .collect();
            return Ok((BODY, legs));
        }
        let middle = inner.iter().map(|name| points.at(name)).sum::<Vector3<f64>>() / inner.len() as f64;
        let body = self.b.body(&points.name(what), middle);
        if inner.iter().any(|name| soft.contains_key(*name)) {
            for name in inner {
                let centre = points.at(name);
                match soft.get(*name) {
                    Some(bushing) => self.bushing(points, body, inner, name, bushing)?,
                    None => {
                        let kind = Kind::Spherical { s_i: centre, s_j: self.b.local(body, centre) };
                        self.b.constrain(points.name(&format!("{what}, {name}")), BODY, body, kind);
                    }
                }
            }
        } else if let [front, rear] = inner {
            let axes = triad_along(&(points.at(front) - points.at(rear))).ok_or_else(|| degenerate(what))?;
            let (on_i, on_j) = (self.b.frame(BODY, middle, &axes), self.b.frame(body, middle, &axes));
            let name = points.name(&format!("{what} hinge"));
            self.b.constrain(name, BODY, body, Kind::Revolute { on_i, on_j });
        } else {
            let (pin, across) = cross_joint(&(ball - middle), what)?;
            let on_i = self.b.frame(BODY, middle, &triad_along(&pin).ok_or_else(|| degenerate(what))?);
            let on_j = self.b.frame(body, middle, &triad_along(&across).ok_or_else(|| degenerate(what))?);
            let name = points.name(&format!("{what}, inner"));
            self.b.constrain(name, BODY, body, Kind::Universal { on_i, on_j });
        }
        let kind = Kind::Spherical { s_i: self.b.local(body, ball), s_j: self.b.local(knuckle, ball) };
        let joint = self.b.constrain(points.name(&format!("{what} ball joint")), body, knuckle, kind);
        Ok((body, vec![joint]))
    }

    fn bushing(
        &mut self,
        points: &Points,
        body: usize,
        inner: &[&str],
        name: &str,
        bushing: &Bushing,
    ) -> Result<(), AssemblyError> {
        let axis = match (bushing.axis, inner) {
            // Given for the left side; the right one is its mirror image.
            (Some([x, y, z]), _) => Vector3::new(x, if points.side == 0 { y } else { -y }, z),
            (None, [front, rear]) => points.at(front) - points.at(rear),
            (None, _) => Vector3::zeros(),
        };
        let axes = triad_along(&axis).ok_or_else(|| degenerate(&format!("the bushing {name}")))?;
        let radial = bushing.radial_n_per_m;
        let along = Matrix3::from_diagonal(&Vector3::new(radial, radial, bushing.axial_n_per_m));
        let damping = bushing
            .damping
            .as_ref()
            .map_or((0.0, 0.0, 0.0), |d| (d.radial_n_s_per_m, d.axial_n_s_per_m, d.torsional_n_m_s_per_rad));
        let damping_along = Matrix3::from_diagonal(&Vector3::new(damping.0, damping.0, damping.1));
        let anchor = points.at(name);
        self.bushings.push(BushingElement {
            body,
            s: self.b.local(body, anchor),
            anchor,
            stiffness: axes * along * axes.transpose(),
            torsion: bushing.torsional_n_m_per_rad,
            damping: axes * damping_along * axes.transpose(),
            torsion_damping: damping.2,
        });
        let place = self.axle.geometry.body_points().iter().position(|known| *known == name);
        self.names.push((points.name(name), points.side, place.unwrap_or_default()));
        Ok(())
    }
}
