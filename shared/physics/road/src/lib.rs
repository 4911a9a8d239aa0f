//! The road under each wheel: friction by place, grade and bank, and an OpenCRG surface on top.
//!
//! Frame: earth axes, ISO 8855. In: where each wheel centre stands and where the wheel heads. Out: a plane through the
//! road straight below ([`Contact`]), as a tyre with one contact point takes it. No heap, no state of the physics: the
//! searches along the reference line only remember where they ended.
//!
//! The plane through an OpenCRG surface is the least-squares one through [`ALONG`] by [`ACROSS`] elevations spread over a
//! patch under the wheel (its size is the scenario's). That is a crude stand-in for how a tyre envelops: shorter bumps than
//! the patch are averaged, not followed by cams [as Schmeitz, PhD thesis TU Delft 2004, ch. 4, does]; wavelengths well
//! above the patch's length are exact.
//!
//! OpenCRG: the crate `opencrg` (elevations as the ASAM C-API to the last bit, by its own account). It falls short of: a
//! reference line given as x, y channels; `REFLINE_CONTINUATION` on a closed line (both refused when loading); friction
//! (OpenCRG 2 carries none; patches of the scenario are laid over it).

use config::road::{Friction, Outside, Surface};
use config::{SurfaceFiles, road};
use opencrg::{CrgGrid, SearchHint, Uv, Xy};

/// Wheels.
pub const WHEELS: usize = 4;
/// Elevations along a patch.
pub const ALONG: usize = 5;
/// Elevations across a patch.
pub const ACROSS: usize = 3;

/// Where a wheel stands.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Place {
    /// Wheel centre, earth x. [m]
    pub x_m: f64,
    /// Wheel centre, earth y. [m]
    pub y_m: f64,
    /// Heading of the wheel from earth x, left positive. [rad]
    pub heading_rad: f64,
}

/// The road below a wheel centre: a plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Contact {
    /// Height straight below. [m]
    pub height_m: f64,
    /// Slope along earth x. [-]
    pub slope_x: f64,
    /// Slope along earth y. [-]
    pub slope_y: f64,
    /// Friction relative to that of the tyre's test surface. [-]
    pub friction: f64,
    /// Whether part of the patch is beyond the surface's grid, or in a hole of it.
    pub outside: bool,
}

/// A road.
#[derive(Debug, Clone)]
pub struct Road {
    plane: [f64; 2],
    friction: Friction,
    surface: Option<Laid>,
}

/// An OpenCRG surface where it is laid.
#[derive(Debug, Clone)]
struct Laid {
    grid: CrgGrid,
    hints: [SearchHint; WHEELS],
    config: Surface,
    /// Begin of the reference line in the file's frame, and its elevation there.
    begin: Xy,
    begin_z: f64,
    /// Cosine and sine of the turn from the file's frame to earth.
    turn: [f64; 2],
    u: (f64, f64),
    v: (f64, f64),
}

impl Road {
    /// Lays the road of a scenario. `files` are those of its surface, if it has one.
    ///
    /// # Errors
    /// A surface without its files, or files that are not OpenCRG.
    pub fn new(road: &road::Road, files: Option<&SurfaceFiles>) -> Result<Self, String> {
        let surface = match (&road.surface, files) {
            (None, _) => None,
            (Some(_), None) => return Err("road.surface: its file was not loaded".to_owned()),
            (Some(config), Some(files)) => Some(Laid::new(config, files.grid()?)),
        };
        Ok(Self {
            plane: [0.01 * road.grade_percent, 0.01 * road.bank_percent],
            friction: road.friction.clone(),
            surface,
        })
    }

    /// The road under each wheel.
    pub fn contacts(&mut self, places: &[Place; WHEELS]) -> [Contact; WHEELS] {
        let [slope_x, slope_y] = self.plane;
        std::array::from_fn(|i| {
            let place = &places[i];
            let mut contact = Contact {
                height_m: slope_x * place.x_m + slope_y * place.y_m,
                slope_x,
                slope_y,
                friction: friction(&self.friction, place.x_m, place.y_m),
                outside: false,
            };
            if let Some(surface) = &mut self.surface {
                surface.lay(i, place, &mut contact);
            }
            contact
        })
    }

    /// Height of the road at a point, and its position (u, v) along the surface's reference line, if there is a
    /// surface. Searches from scratch: not for the step.
    pub fn at(&self, x_m: f64, y_m: f64) -> (f64, Option<[f64; 2]>) {
        let plane = self.plane[0] * x_m + self.plane[1] * y_m;
        let Some(surface) = &self.surface else { return (plane, None) };
        let mut hint = SearchHint::default();
        let uv = surface.grid.uv_from_xy(surface.to_file(x_m, y_m));
        (plane + surface.height(x_m, y_m, &mut hint).0, uv.map(|uv| [uv.u, uv.v]))
    }
}

impl Laid {
    fn new(config: &Surface, grid: CrgGrid) -> Self {
        let (u, v) = (grid.u_range(), grid.v_range());
        let at = Uv { u: u.0, v: 0.0_f64.clamp(v.0, v.1) };
        let begin = grid.xy_from_uv(Uv { u: u.0, v: 0.0 });
        let turn = config.heading_deg.to_radians() - grid.heading_at_uv(at).phi;
        let begin_z = grid.elevation_at_uv(at).unwrap_or(0.0);
        Self {
            hints: [SearchHint::default(); WHEELS],
            config: config.clone(),
            begin,
            begin_z,
            turn: [turn.cos(), turn.sin()],
            u,
            v,
            grid,
        }
    }

    /// A point of the earth frame in the file's.
    fn to_file(&self, x_m: f64, y_m: f64) -> Xy {
        let (dx, dy) = (x_m - self.config.begin_x_m, y_m - self.config.begin_y_m);
        let [c, s] = self.turn;
        Xy { x: self.begin.x + c * dx + s * dy, y: self.begin.y - s * dx + c * dy }
    }

    /// Height at a point, and whether it is beyond the grid.
    fn height(&self, x_m: f64, y_m: f64, hint: &mut SearchHint) -> (f64, bool) {
        let Some(uv) = self.grid.uv_from_xy_near(self.to_file(x_m, y_m), hint) else { return (0.0, true) };
        let held = Uv { u: uv.u.clamp(self.u.0, self.u.1), v: uv.v.clamp(self.v.0, self.v.1) };
        let outside = held != uv;
        let elevation = match self.config.outside {
            Outside::Zero if outside => None,
            Outside::File => self.grid.elevation_at_uv(uv),
            Outside::Hold | Outside::Zero => self.grid.elevation_at_uv(held),
        };
        match elevation {
            Some(z) => (self.config.begin_height_m + self.config.height_scale * (z - self.begin_z), outside),
            None => (0.0, true),
        }
    }

    /// Adds the surface's plane under a wheel.
    fn lay(&mut self, wheel: usize, place: &Place, contact: &mut Contact) {
        let (sine, cosine) = place.heading_rad.sin_cos();
        let mut hint = self.hints[wheel];
        let half = [0.5 * self.config.patch_length_m, 0.5 * self.config.patch_width_m];
        let (mut mean, mut along, mut across) = (0.0, 0.0, 0.0);
        for i in 0..ALONG {
            let l = (2.0 * i as f64 / (ALONG - 1) as f64 - 1.0) * half[0];
            for j in 0..ACROSS {
                let w = (2.0 * j as f64 / (ACROSS - 1) as f64 - 1.0) * half[1];
                let x = place.x_m + l * cosine - w * sine;
                let y = place.y_m + l * sine + w * cosine;
                let (z, outside) = self.height(x, y, &mut hint);
                contact.outside |= outside;
                mean += z;
                along += l * z;
                across += w * z;
            }
        }
        self.hints[wheel] = hint;
        // Least squares on a symmetric grid: mean, and first moments over second moments.
        let count = (ALONG * ACROSS) as f64;
        let along = along / (ACROSS as f64 * second_moment(ALONG) * half[0] * half[0]);
        let across = across / (ALONG as f64 * second_moment(ACROSS) * half[1] * half[1]);
        contact.height_m += mean / count;
        contact.slope_x += along * cosine - across * sine;
        contact.slope_y += along * sine + across * cosine;
    }
}

/// Sum of squares of `n` points spread evenly over [-1, 1].
fn second_moment(n: usize) -> f64 {
    (0..n).map(|i| (2.0 * i as f64 / (n - 1) as f64 - 1.0).powi(2)).sum()
}

/// Friction scale at a point of the road.
fn friction(friction: &Friction, x_m: f64, y_m: f64) -> f64 {
    match friction {
        Friction::Uniform { scale } => *scale,
        Friction::Split { left_scale, right_scale, outside_scale, from_x_m, to_x_m } => {
            if !(*from_x_m..*to_x_m).contains(&x_m) {
                *outside_scale
            } else if y_m > 0.0 {
                *left_scale
            } else {
                *right_scale
            }
        }
        Friction::Patches { outside_scale, patches } => patches
            .iter()
            .find(|p| (p.from_x_m..p.to_x_m).contains(&x_m) && (p.from_y_m..p.to_y_m).contains(&y_m))
            .map_or(*outside_scale, |p| p.scale),
    }
}
