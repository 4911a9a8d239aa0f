//! Suspensions composed from the constraint library, after the source's tables 4.3–4.8: each stage's
//! bodies and constraints as data. Frame: car body. The knuckle's origin is the wheel centre and its axes
//! are the body's at design, so that its frame is the knuckle frame K of the loads.

use config::axle::{Axle, Geometry, Link, StrutReactionLine};
use spatial::{Matrix3, Vector3, triad_along};

use super::model::{BODY, Bar, Builder, Follow, Model, RACK, RACK_DRIVER, Side, SteeringAxis};
use crate::body::Pose;
use crate::constraint::Kind;
use crate::failure::AssemblyError;

const SIDE_NAMES: [&str; 2] = ["left", "right"];

/// One side's named points.
pub(super) struct Points<'a> {
    pub geometry: &'a Geometry,
    pub side: usize,
}

impl Points<'_> {
    /// A point that the geometry's type has by definition. [m]
    pub fn at(&self, name: &str) -> Vector3<f64> {
        let point = self.geometry.point(self.side, name);
        debug_assert!(point.is_some(), "no hardpoint {name}");
        Vector3::from(point.unwrap_or([f64::NAN; 3]))
    }

    pub fn name(&self, what: &str) -> String {
        format!("{} {what}", SIDE_NAMES[self.side])
    }
}

/// Composes both stages.
pub(crate) fn assemble(axle: &Axle) -> Result<Model, AssemblyError> {
    let sides = [0, 1].map(|side| Points { geometry: &axle.geometry, side });
    let mut kinematic = base(&sides)?;
    let mut reaction = kinematic.clone();
    let mut follow = vec![Follow::Same(BODY), Follow::Same(RACK)];
    let knuckles = [0, 1].map(|side| {
        let centre = sides[side].at("wheel_centre");
        follow.push(Follow::Same(2 + side));
        reaction.body(&sides[side].name("knuckle"), centre);
        kinematic.body(&sides[side].name("knuckle"), centre)
    });
    let mut built = Vec::with_capacity(2);
    for points in &sides {
        let knuckle = knuckles[points.side];
        let mut stages = Stages { kinematic: &mut kinematic, reaction: &mut reaction, follow: &mut follow };
        let carried = match &axle.geometry {
            Geometry::DoubleWishbone(_) => stages.double_wishbone(points, knuckle)?,
            Geometry::Strut(strut) => stages.strut(points, knuckle, strut.reaction_line)?,
            Geometry::FiveLink(five) => stages.five_link(points, knuckle, five.spring_on)?,
        };
        let [_, tie_rod] = stages.link(
            "tie rod",
            points,
            RACK,
            points.at("tierod_inner"),
            knuckle,
            points.at("tierod_outer"),
        );
        let centre = points.at("wheel_centre");
        built.push(Side {
            knuckle,
            tie_rod_outer: points.at("tierod_outer") - centre,
            contact_patch: points.at("contact_patch") - centre,
            spin_axis: Vector3::from(axle.spin_axis(points.side)),
            wheel_centre_z: centre.z,
            steering_axis: carried.steering_axis,
            tie_rod,
            spring: carried.spring,
            drop_link: None,
            upper: carried.upper,
            lower: carried.lower,
            spring_ends: carried.spring_ends,
        });
    }
    let bar = match &axle.stabiliser {
        Some(stabiliser) => {
            let mut stages =
                Stages { kinematic: &mut kinematic, reaction: &mut reaction, follow: &mut follow };
            Some(stages.stabiliser(stabiliser, &sides, knuckles, &mut built)?)
        }
        None => None,
    };
    drive_rack(&mut kinematic);
    drive_rack(&mut reaction);
    for (side, points) in sides.iter().enumerate() {
        let kind = Kind::AxisDriver { s_j: Vector3::zeros(), axis: 2, driver: 1 + side };
        kinematic.constrain(points.name("wheel height"), knuckles[side], knuckles[side], kind);
    }
    let Ok(sides) = <[Side; 2]>::try_from(built) else {
        return Err(AssemblyError::Degenerate { what: "an axle of other than two sides".to_owned() });
    };
    Ok(Model { kinematic, reaction, follow, sides, bar })
}

pub(super) fn degenerate(what: &str) -> AssemblyError {
    AssemblyError::Degenerate { what: what.to_owned() }
}

/// Car body on the ground, rack sliding in it along y.
pub(super) fn base(sides: &[Points; 2]) -> Result<Builder, AssemblyError> {
    let mut b = Builder::default();
    b.body("body", Vector3::zeros());
    b.body("rack", 0.5 * (sides[0].at("tierod_inner") + sides[1].at("tierod_inner")));
    b.constrain("ground".to_owned(), BODY, BODY, Kind::Ground { pose: Pose::IDENTITY });
    let axes = triad_along(&Vector3::y()).ok_or_else(|| degenerate("the rack"))?;
    let middle = b.design[RACK].r;
    let (on_i, on_j) = (b.frame(BODY, middle, &axes), b.frame(RACK, middle, &axes));
    b.constrain("rack guide".to_owned(), BODY, RACK, Kind::Translational { on_i, on_j });
    Ok(b)
}

/// Cross-joint axes of a link: the pin on the body, near vertical and normal to the link at design, and the
/// axis on the link, normal to both.
pub(super) fn cross_joint(
    link: &Vector3<f64>,
    what: &str,
) -> Result<(Vector3<f64>, Vector3<f64>), AssemblyError> {
    let triad = triad_along(link).ok_or_else(|| degenerate(what))?;
    let along: Vector3<f64> = triad.column(2).into_owned();
    let pin = if along.z.abs() < 0.9 { Vector3::z() } else { triad.column(0).into_owned() };
    let pin = (pin - along * along.dot(&pin)).normalize();
    Ok((pin, pin.cross(&along)))
}

fn drive_rack(b: &mut Builder) {
    let axes = Matrix3::from_columns(&[Vector3::z(), Vector3::x(), Vector3::y()]);
    let on_i = b.frame(BODY, b.design[RACK].r, &axes);
    let kind = Kind::TranslationalDriver { on_i, s_j: Vector3::zeros(), driver: RACK_DRIVER };
    b.constrain("rack stroke".to_owned(), BODY, RACK, kind);
}

/// What a linkage hands to its side.
struct Carried {
    steering_axis: SteeringAxis,
    spring: usize,
    spring_ends: [(usize, Vector3<f64>); 2],
    upper: Vec<usize>,
    lower: Vec<usize>,
}

/// Both stages under construction.
struct Stages<'a> {
    kinematic: &'a mut Builder,
    reaction: &'a mut Builder,
    follow: &'a mut Vec<Follow>,
}

impl Stages<'_> {
    /// The same link in both stages; `j` is the same body in both.
    fn link(
        &mut self,
        what: &str,
        points: &Points,
        i: usize,
        p_i: Vector3<f64>,
        j: usize,
        p_j: Vector3<f64>,
    ) -> [usize; 2] {
        [
            self.kinematic.link(points.name(what), i, p_i, j, p_j),
            self.reaction.link(points.name(what), i, p_i, j, p_j),
        ]
    }

    /// Upper and lower arm as two links each; for the forces the lower arm is a body on a hinge that
    /// carries the spring.
    fn double_wishbone(&mut self, points: &Points, knuckle: usize) -> Result<Carried, AssemblyError> {
        let ball = points.at("uca_ball");
        let upper = ["uca_front", "uca_rear"].map(|inner| {
            let what = ["upper arm, front leg", "upper arm, rear leg"][usize::from(inner == "uca_rear")];
            self.link(what, points, BODY, points.at(inner), knuckle, ball)[1]
        });
        let (front, rear, ball) = (points.at("lca_front"), points.at("lca_rear"), points.at("lca_ball"));
        let k = &mut *self.kinematic;
        k.link(points.name("lower arm, front leg"), BODY, front, knuckle, ball);
        k.link(points.name("lower arm, rear leg"), BODY, rear, knuckle, ball);
        let axes = triad_along(&(front - rear)).ok_or_else(|| degenerate("the lower arm's hinge"))?;
        let axis: Vector3<f64> = axes.column(2).into_owned();
        let arm = self.reaction.body(&points.name("lower arm"), 0.5 * (front + rear));
        let r = &mut *self.reaction;
        self.follow.push(Follow::Hinged {
            origin: rear,
            axis,
            design: r.design[arm].r - rear,
            tip: ball - rear,
            body: knuckle,
            point: k.local(knuckle, ball),
        });
        let hinge = r.design[arm].r;
        let (on_i, on_j) = (r.frame(BODY, hinge, &axes), r.frame(arm, hinge, &axes));
        r.constrain(points.name("lower arm hinge"), BODY, arm, Kind::Revolute { on_i, on_j });
        let kind = Kind::Spherical { s_i: r.local(arm, ball), s_j: r.local(knuckle, ball) };
        let lower = r.constrain(points.name("lower ball joint"), arm, knuckle, kind);
        let (top, seat) = (points.at("spring_upper"), points.at("spring_lower"));
        let spring = r.link(points.name("spring"), BODY, top, arm, seat);
        Ok(Carried {
            steering_axis: SteeringAxis::Points {
                lower: (knuckle, self.kinematic.local(knuckle, ball)),
                upper: (knuckle, self.kinematic.local(knuckle, points.at("uca_ball"))),
            },
            spring,
            spring_ends: [(BODY, self.reaction.local(BODY, top)), (arm, self.reaction.local(arm, seat))],
            upper: upper.to_vec(),
            lower: vec![lower],
        })
    }

    /// Lower arm as two links; the top mount stays on the strut's line, which is fixed in the knuckle.
    fn strut(
        &mut self,
        points: &Points,
        knuckle: usize,
        line: StrutReactionLine,
    ) -> Result<Carried, AssemblyError> {
        let (top, low, ball) = (points.at("strut_top"), points.at("strut_lower"), points.at("lca_ball"));
        let axes = triad_along(&(top - low)).ok_or_else(|| degenerate("the strut"))?;
        let mut strut = [0; 2];
        for (b, index) in [&mut *self.kinematic, &mut *self.reaction].into_iter().zip(&mut strut) {
            let kind = Kind::Strut { on_i: b.frame(knuckle, low, &axes), s_j: b.local(BODY, top) };
            *index = b.constrain(points.name("strut"), knuckle, BODY, kind);
        }
        let lower = [("lower arm, front leg", "lca_front"), ("lower arm, rear leg", "lca_rear")]
            .map(|(what, inner)| self.link(what, points, BODY, points.at(inner), knuckle, ball)[1]);
        let seat = match line {
            StrutReactionLine::LowerBallToTop => ball,
            StrutReactionLine::StrutAxis => low,
        };
        let r = &mut *self.reaction;
        let spring = r.link(points.name("spring"), BODY, top, knuckle, seat);
        Ok(Carried {
            steering_axis: SteeringAxis::Points {
                lower: (knuckle, r.local(knuckle, ball)),
                upper: (BODY, r.local(BODY, top)),
            },
            spring,
            spring_ends: [(BODY, r.local(BODY, top)), (knuckle, r.local(knuckle, low))],
            upper: vec![strut[1], spring],
            lower: lower.to_vec(),
        })
    }

    /// Four links; for the forces the one with the spring is a body on a cross joint.
    fn five_link(
        &mut self,
        points: &Points,
        knuckle: usize,
        spring_on: Link,
    ) -> Result<Carried, AssemblyError> {
        let (mut upper, mut lower) = (Vec::new(), Vec::new());
        let (top, seat) = (points.at("spring_upper"), points.at("spring_lower"));
        let mut carried = (0, BODY);
        for link in Link::ALL {
            let what = link.name().replace('_', " ") + " link";
            let inner = points.at(&format!("{}_inner", link.name()));
            let outer = points.at(&format!("{}_outer", link.name()));
            let action = if link == spring_on {
                self.kinematic.link(points.name(&what), BODY, inner, knuckle, outer);
                let along = (outer - inner).normalize();
                let (pin, across) = cross_joint(&along, &what)?;
                let r = &mut *self.reaction;
                let body = r.body(&points.name(&what), inner);
                self.follow.push(Follow::Link {
                    origin: inner,
                    cross: pin,
                    triad: Matrix3::from_columns(&[along, across, along.cross(&across)]),
                    body: knuckle,
                    point: r.local(knuckle, outer),
                });
                let on_i = r.frame(BODY, inner, &triad_along(&pin).ok_or_else(|| degenerate(&what))?);
                let on_j = r.frame(body, inner, &triad_along(&across).ok_or_else(|| degenerate(&what))?);
                r.constrain(
                    points.name(&(what.clone() + ", inner")),
                    BODY,
                    body,
                    Kind::Universal { on_i, on_j },
                );
                let kind = Kind::Spherical { s_i: r.local(body, outer), s_j: r.local(knuckle, outer) };
                let ball = r.constrain(points.name(&(what + ", outer")), body, knuckle, kind);
                carried = (r.link(points.name("spring"), BODY, top, body, seat), body);
                ball
            } else {
                self.link(&what, points, BODY, inner, knuckle, outer)[1]
            };
            match link {
                Link::UpperFront | Link::UpperRear => upper.push(action),
                Link::LowerFront | Link::LowerRear => lower.push(action),
            }
        }
        let (spring, body) = carried;
        let spring_ends = [(BODY, self.reaction.local(BODY, top)), (body, self.reaction.local(body, seat))];
        Ok(Carried { steering_axis: SteeringAxis::Instantaneous, spring, spring_ends, upper, lower })
    }

    /// Two halves hinged on the body about the common axis, drop links to the knuckles.
    fn stabiliser(
        &mut self,
        stabiliser: &config::axle::Stabiliser,
        points: &[Points; 2],
        knuckles: [usize; 2],
        sides: &mut [Side],
    ) -> Result<Bar, AssemblyError> {
        let ends = stabiliser.sides();
        let axis = Vector3::from(ends[0].arb_bush_m) - Vector3::from(ends[1].arb_bush_m);
        let axes = triad_along(&axis).ok_or_else(|| degenerate("the stabiliser"))?;
        let (mut kinematic, mut reaction) = ([0; 2], [0; 2]);
        for side in 0..2 {
            let bush = Vector3::from(ends[side].arb_bush_m);
            let (end, upper) =
                (Vector3::from(ends[side].arb_arm_end_m), Vector3::from(ends[side].droplink_upper_m));
            let mut drop_link = 0;
            for (b, halves) in [(&mut *self.kinematic, &mut kinematic), (&mut *self.reaction, &mut reaction)]
            {
                let half = b.body(&points[side].name("bar half"), bush);
                halves[side] = half;
                let (on_i, on_j) = (b.frame(BODY, bush, &axes), b.frame(half, bush, &axes));
                b.constrain(points[side].name("bar bush"), BODY, half, Kind::Revolute { on_i, on_j });
                drop_link = b.link(points[side].name("drop link"), half, end, knuckles[side], upper);
            }
            sides[side].drop_link = Some(drop_link);
            self.follow.push(Follow::Same(kinematic[side]));
        }
        let axis = axes.column(2).into_owned();
        Ok(Bar { axis, stiffness: stabiliser.stiffness_n_m_per_rad, kinematic, reaction })
    }
}
