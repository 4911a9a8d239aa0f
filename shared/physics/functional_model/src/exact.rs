//! The exact step: between two samples a linear model is x' = A x + B u + a, whose solution over dt is the exponential
//! of the augmented matrix; refreshed when sampled coefficients have changed (Van Loan 1978, IEEE TAC 23, 395).

use crate::dense::Exponential;
use crate::kernel::{Kernel, Newton, dot};

/// The exact step of what is linear between samples.
pub(crate) struct ExactStep {
    /// Augmented [x, u, 1] matrix and its exponential over dt.
    pub a: Vec<f64>,
    pub phi: Vec<f64>,
    pub exponential: Exponential,
    pub size: usize,
    pub held: Vec<f64>,
    pub valid: bool,
    pub z: Vec<f64>,
    pub core_map: Vec<f64>,
}

impl ExactStep {
    /// The augmented matrix at the present sampled values: core solved as a function of [x, u, 1].
    pub fn refresh(&mut self, kernel: &Kernel, newton: &mut Newton, known: &[f64], n: usize, nu: usize) {
        let (nc, size) = (kernel.core.len(), self.size);
        let nm = kernel.sampled.len();
        // Non-linear parts are affine given the sampled values: value at zero plus partials.
        for a in 0..kernel.args.count {
            newton.registers[a] =
                if kernel.arg_sampled[a] { dot(kernel.args.known_row(a), known) } else { 0.0 };
        }
        kernel.program.run(&mut newton.registers, &kernel.tables);
        newton.jacobian(kernel, &kernel.args, &kernel.equations);
        // The Jacobian must not see sampled arguments; their rows carry no core, so it does not.
        let factored = nc == 0 || newton.lu.factor();
        for column in 0..size {
            if nc == 0 {
                break;
            }
            for i in 0..nc {
                let row = kernel.equations.known_row(i);
                newton.residual[i] = if column < n + nu {
                    -row[column]
                } else {
                    let held: f64 = (0..nm).map(|k| row[n + nu + k] * known[n + nu + k]).sum();
                    -(row[n + nu + nm + 1] + held + kernel.program.output(&newton.registers, i))
                };
            }
            for (i, a, p) in &kernel.partials {
                if kernel.arg_sampled[*a] {
                    continue;
                }
                let v = match p {
                    crate::kernel::Partial::Constant(v) => *v,
                    crate::kernel::Partial::Output(k) => kernel.program.output(&newton.registers, *k),
                };
                let row = kernel.args.known_row(*a);
                let w = if column < n + nu {
                    row[column]
                } else {
                    row[n + nu + nm + 1] + (0..nm).map(|k| row[n + nu + k] * known[n + nu + k]).sum::<f64>()
                };
                newton.residual[*i] -= v * w;
            }
            if factored {
                newton.lu.solve(&mut newton.residual);
            }
            for i in 0..nc {
                self.core_map[i * size + column] = newton.residual[i];
            }
        }
        self.a.fill(0.0);
        for i in 0..n {
            let row = kernel.rates.known_row(i);
            for column in 0..n + nu {
                self.a[i * size + column] = row[column];
            }
            self.a[i * size + size - 1] =
                row[n + nu + nm + 1] + (0..nm).map(|k| row[n + nu + k] * known[n + nu + k]).sum::<f64>();
            for (k, c) in kernel.rates.core_row(i).iter().enumerate() {
                if *c != 0.0 {
                    for column in 0..size {
                        self.a[i * size + column] += c * self.core_map[k * size + column];
                    }
                }
            }
        }
    }
}
