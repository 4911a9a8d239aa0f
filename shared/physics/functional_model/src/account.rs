//! Power and energy at run time. The residual of a joint is the sum of the powers that its parts' own ports see, each
//! in its part's own frame; the whole-model account adds, from the parts' own statements, stored energy, losses
//! and supply:   supplied through open ports + sources = stored + lost + (parts that state no energy).
//! Neither uses the transposed matrices of the composition, so a wrong one shows.
//! Integrals use the points of the method itself: the mid-point (exact for quadratic energies), the Runge-Kutta
//! stages, or four Gauss points of the exact solution.

use crate::dense::Exponential;
use crate::flat::Flat;
use crate::kernel::{Kernel, Reader, dot};
use crate::pool::Id;
use crate::reduce::Dae;

/// Powers at the end of the last step and energies since the start. SI.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Account {
    /// Joints, in file order.
    pub joints: Vec<String>,
    /// Residual of each joint: sum of the powers its ports give, W. Zero if power is kept.
    pub residual_w: Vec<f64>,
    /// Sum of the magnitudes of those powers, W.
    pub flowing_w: Vec<f64>,
    /// Stored energy now, J.
    pub stored_j: f64,
    /// Through open ports into the model, J.
    pub entered_j: f64,
    /// From sources inside, J.
    pub supplied_j: f64,
    /// Lost in parts that state their loss, J.
    pub lost_j: f64,
    /// Into parts that state no energy, loss or supply, J.
    pub unstated_j: f64,
    /// Jumps of stored energy at samples (frames or coefficients that change at once), J.
    pub sampled_j: f64,
    /// Stored energy at the start, J.
    pub start_j: f64,
    /// Sum of the magnitudes of all energies moved, J: what the imbalance is to be compared with.
    pub moved_j: f64,
}

impl Account {
    /// entered + supplied + sampled - lost - unstated - (stored - start), J. Zero if the account closes.
    pub fn imbalance_j(&self) -> f64 {
        self.entered_j + self.supplied_j + self.sampled_j
            - self.lost_j
            - self.unstated_j
            - (self.stored_j - self.start_j)
    }

    /// Largest joint residual relative to the largest power flowing anywhere.
    pub fn worst_residual(&self) -> f64 {
        let flow = self.flowing_w.iter().fold(0.0f64, |m, v| m.max(*v));
        let worst = self.residual_w.iter().fold(0.0f64, |m, v| m.max(v.abs()));
        if flow > 0.0 { worst / flow } else { worst }
    }
}

/// Gauss-Legendre points and weights on (0, 1), four points.
const GAUSS: [(f64, f64); 4] = [
    (0.069_431_844_202_973_71, 0.173_927_422_568_726_92),
    (0.330_009_478_207_571_87, 0.326_072_577_431_273_08),
    (0.669_990_521_792_428_1, 0.326_072_577_431_273_08),
    (0.930_568_155_797_026_3, 0.173_927_422_568_726_92),
];

/// Order of the totals in the reader.
const ENTERED: usize = 0;
const SUPPLIED: usize = 1;
const LOST: usize = 2;
const UNSTATED: usize = 3;
const STORED: usize = 4;

pub(crate) struct Accountant {
    pub account: Account,
    totals: Reader,
    joints: Reader,
    /// Exponentials over the Gauss points of a step.
    points: Vec<Vec<f64>>,
    known: Vec<f64>,
    core: Vec<f64>,
}

impl Accountant {
    pub fn build(flat: &mut Flat, kernel: &Kernel, dae: &Dae) -> Accountant {
        let power = |flat: &mut Flat, across: &[u32], through: &[u32]| -> Id {
            let terms: Vec<(Id, f64)> = across
                .iter()
                .zip(through)
                .map(|(v, f)| {
                    let (v, f) = (flat.pool.variable(*v as usize), flat.pool.variable(*f as usize));
                    (flat.pool.mul(v, f), 1.0)
                })
                .collect();
            flat.pool.sum(&terms, 0.0)
        };
        let mut joint_roots = Vec::new();
        let mut names = Vec::new();
        let mut entered = Vec::new();
        for c in flat.couplings.clone() {
            let mut sum = Vec::new();
            let mut size = Vec::new();
            for (b, p) in &c.members {
                let port = flat.blocks[*b].ports[*p].clone();
                let w = power(flat, &port.across.1, &port.through.1);
                sum.push((w, port.sign()));
                let magnitude = flat.pool.call(crate::pool::Fun::Abs, &[w]);
                size.push((magnitude, 1.0));
            }
            if let Some((across, through, sign)) = &c.outside {
                // `sign` * v f leaves the model to the outside.
                let w = power(flat, across, through);
                sum.push((w, -sign));
                entered.push((w, -sign));
            }
            names.push(c.name.clone());
            joint_roots.push(flat.pool.sum(&sum, 0.0));
            joint_roots.push(flat.pool.sum(&size, 0.0));
        }
        let (mut supplied, mut lost, mut unstated, mut stored) = (vec![], vec![], vec![], vec![]);
        for b in flat.blocks.clone() {
            if b.energy.is_none() && b.loss.is_none() && b.supply.is_none() {
                for p in &b.ports {
                    let w = power(flat, &p.across.1, &p.through.1);
                    unstated.push((w, -p.sign()));
                }
            }
            supplied.extend(b.supply.map(|s| (s, 1.0)));
            lost.extend(b.loss.map(|s| (s, 1.0)));
            stored.extend(b.energy.map(|s| (s, 1.0)));
        }
        let roots: Vec<Id> =
            [entered, supplied, lost, unstated, stored].iter().map(|t| flat.pool.sum(t, 0.0)).collect();
        let totals = kernel.reader(flat, &dae.dependent, &roots);
        let joints = kernel.reader(flat, &dae.dependent, &joint_roots);
        let n = names.len();
        Accountant {
            account: Account {
                joints: names,
                residual_w: vec![0.0; n],
                flowing_w: vec![0.0; n],
                ..Account::default()
            },
            totals,
            joints,
            points: vec![vec![0.0; (kernel.states.len() + kernel.inputs.len() + 1).pow(2)]; GAUSS.len()],
            known: vec![0.0; kernel.known_width()],
            core: vec![0.0; kernel.core.len()],
        }
    }

    pub fn needs_core(&self) -> bool {
        self.totals.needs_core
    }

    pub fn reset(&mut self, known: &[f64], core: &[f64], kernel: &Kernel) {
        let a = &mut self.account;
        for v in [
            &mut a.entered_j,
            &mut a.supplied_j,
            &mut a.lost_j,
            &mut a.unstated_j,
            &mut a.sampled_j,
            &mut a.moved_j,
        ] {
            *v = 0.0;
        }
        self.close(known, core, kernel);
        self.account.start_j = self.account.stored_j;
    }

    /// Adds the powers at one point, weighted by a time.
    pub fn add(&mut self, known: &[f64], core: &[f64], kernel: &Kernel, weight: f64) {
        self.totals.read(known, core, &kernel.tables);
        self.book(weight);
    }

    fn book(&mut self, weight: f64) {
        let a = &mut self.account;
        let w = [ENTERED, SUPPLIED, LOST, UNSTATED].map(|k| self.totals.value(k) * weight);
        a.entered_j += w[0];
        a.supplied_j += w[1];
        a.lost_j += w[2];
        a.unstated_j += w[3];
        a.moved_j += w.iter().map(|v| v.abs()).sum::<f64>();
    }

    pub fn prepare_exact(&mut self, a: &[f64], size: usize, dt: f64, exponential: &mut Exponential) {
        debug_assert_eq!(a.len(), size * size);
        for (point, phi) in GAUSS.iter().zip(&mut self.points) {
            exponential.of(a, dt * point.0, phi);
        }
    }

    /// Integrates the powers over an exact step from z = [x, u, 1].
    #[allow(clippy::too_many_arguments)]
    pub fn add_exact(
        &mut self,
        z: &[f64],
        core_map: &[f64],
        known: &[f64],
        n: usize,
        nu: usize,
        kernel: &Kernel,
        dt: f64,
    ) {
        let size = z.len();
        let at = known.len() - 2;
        for (k, point) in GAUSS.iter().enumerate() {
            self.known.copy_from_slice(known);
            for i in 0..n {
                self.known[i] = dot(&self.points[k][i * size..(i + 1) * size], z);
            }
            self.known[at] = known[at] + dt * point.0;
            for (i, c) in self.core.iter_mut().enumerate() {
                let row = &core_map[i * size..(i + 1) * size];
                *c = dot(&row[..n + nu], &self.known[..n + nu]) + row[n + nu];
            }
            self.totals.read(&self.known, &self.core, &kernel.tables);
            self.book(point.1 * dt);
        }
    }

    /// Stored energy after a sample's jump.
    pub fn after_sample(&mut self, known: &[f64], core: &[f64], kernel: &Kernel) {
        self.totals.read(known, core, &kernel.tables);
        let jump = self.totals.value(STORED) - self.account.stored_j;
        self.account.sampled_j += jump;
        self.account.stored_j += jump;
    }

    /// Powers and stored energy at the end of a step.
    pub fn close(&mut self, known: &[f64], core: &[f64], kernel: &Kernel) {
        self.totals.read(known, core, &kernel.tables);
        self.account.stored_j = self.totals.value(STORED);
        self.joints.read(known, core, &kernel.tables);
        for k in 0..self.account.joints.len() {
            self.account.residual_w[k] = self.joints.value(2 * k);
            self.account.flowing_w[k] = self.joints.value(2 * k + 1);
        }
    }

    pub fn state_len(&self) -> usize {
        8
    }

    pub fn save(&self, out: &mut [f64]) {
        let a = &self.account;
        out.copy_from_slice(&[
            a.stored_j,
            a.entered_j,
            a.supplied_j,
            a.lost_j,
            a.unstated_j,
            a.sampled_j,
            a.start_j,
            a.moved_j,
        ]);
    }

    pub fn load(&mut self, from: &[f64]) {
        let a = &mut self.account;
        [a.stored_j, a.entered_j, a.supplied_j, a.lost_j, a.unstated_j, a.sampled_j, a.start_j, a.moved_j] =
            [from[0], from[1], from[2], from[3], from[4], from[5], from[6], from[7]];
    }
}
