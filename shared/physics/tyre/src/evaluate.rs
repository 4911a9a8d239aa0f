//! Evaluation of a table of contacts: CSV text in, CSV text out, columns as in the tyre reference tables.

use crate::model::{Contact, Tyre, UseMode};
use std::fmt;
use std::fmt::Write as _;

/// Columns of the input. `p_Pa` may be absent: then the file's inflation pressure holds, as it does for 0.
pub const INPUT_COLUMNS: [&str; 7] =
    ["Fz_N", "kappa", "alpha_rad", "gamma_rad", "phit_1pm", "Vx_mps", "p_Pa"];

/// Columns of the output, after those of the input.
pub const OUTPUT_COLUMNS: [&str; 20] = [
    "Fx_N",
    "Fy_N",
    "Mx_Nm",
    "My_Nm",
    "Mz_Nm",
    "Re_m",
    "rho_m",
    "contact_len_m",
    "trail_m",
    "mux",
    "muy",
    "Rl_m",
    "Mzr_Nm",
    "Cx_Npm",
    "Cy_Npm",
    "Cz_Npm",
    "Kya_Nprad",
    "sigmax_m",
    "sigmay_m",
    "Kxk_N",
];

/// One thing wrong with an input table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct EvaluateError {
    /// Line of the text, from 1.
    pub line: usize,
    /// Column name, empty when the whole line is meant.
    pub column: String,
    /// The value as written.
    pub value: String,
    /// The rule that is broken.
    pub rule: String,
}

impl fmt::Display for EvaluateError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "line {}: {}", self.line, self.column)?;
        if !self.value.is_empty() {
            write!(f, " = {}", self.value)?;
        }
        write!(f, ": {}", self.rule)
    }
}

impl std::error::Error for EvaluateError {}

/// Violations beyond this number are not collected.
const ERRORS_MAX: usize = 100;

/// Evaluates each row of `input`. Columns other than [`INPUT_COLUMNS`] are ignored.
///
/// # Errors
/// Missing columns, cells that are not finite numbers, a load below zero, a slip angle of a right angle or more; the
/// first hundred of them.
pub fn evaluate_csv(tyre: &Tyre, input: &str, mode: UseMode) -> Result<String, Vec<EvaluateError>> {
    let mut reader =
        csv::ReaderBuilder::new().trim(csv::Trim::All).comment(Some(b'#')).from_reader(input.as_bytes());
    let broken = |line: usize, column: &str, value: &str, rule: &str| EvaluateError {
        line,
        column: column.to_owned(),
        value: value.to_owned(),
        rule: rule.to_owned(),
    };
    let header = match reader.headers() {
        Ok(header) => header.clone(),
        Err(e) => return Err(vec![broken(1, "", "", &e.to_string())]),
    };
    let mut errors = Vec::new();
    let at = INPUT_COLUMNS.map(|name| header.iter().position(|h| h == name));
    for (name, index) in INPUT_COLUMNS.iter().zip(at) {
        if index.is_none() && *name != "p_Pa" {
            errors.push(broken(1, name, "", "missing column"));
        }
    }
    if !errors.is_empty() {
        return Err(errors);
    }
    let mut out = INPUT_COLUMNS.join(",");
    out.push(',');
    out.push_str(&OUTPUT_COLUMNS.join(","));
    out.push('\n');
    for record in reader.records() {
        if errors.len() >= ERRORS_MAX {
            break;
        }
        let record = match record {
            Ok(record) => record,
            Err(e) => {
                let line = e.position().map_or(0, |p| usize::try_from(p.line()).unwrap_or(0));
                errors.push(broken(line, "", "", "must have as many cells as the first line"));
                continue;
            }
        };
        let line = record.position().map_or(0, |p| usize::try_from(p.line()).unwrap_or(0));
        let mut row = [0.0; 7];
        for i in 0..row.len() {
            let Some(index) = at[i] else { continue };
            let cell = record.get(index).unwrap_or("");
            match cell.parse::<f64>() {
                Ok(value) if value.is_finite() => row[i] = value,
                _ => errors.push(broken(line, INPUT_COLUMNS[i], cell, "must be a finite number")),
            }
        }
        if row[0] < 0.0 {
            errors.push(broken(line, "Fz_N", &row[0].to_string(), "must be >= 0"));
        }
        if row[2].abs() >= std::f64::consts::FRAC_PI_2 {
            errors.push(broken(line, "alpha_rad", &row[2].to_string(), "must be in (-pi/2, pi/2)"));
        }
        if row[6] < 0.0 {
            errors.push(broken(
                line,
                "p_Pa",
                &row[6].to_string(),
                "must be >= 0 (0: inflation pressure of the file)",
            ));
        }
        if errors.is_empty() {
            write_row(tyre, &mut row, mode, &mut out);
        }
    }
    if errors.is_empty() { Ok(out) } else { Err(errors) }
}

fn write_row(tyre: &Tyre, row: &mut [f64; 7], mode: UseMode, out: &mut String) {
    if row[6] == 0.0 {
        row[6] = tyre.info().inflation_pressure_pa;
    }
    let contact = Contact {
        vertical_load_n: row[0],
        slip_ratio: row[1],
        slip_angle_rad: row[2],
        camber_rad: row[3],
        turn_slip_per_m: row[4],
        speed_m_s: row[5],
        pressure_pa: row[6],
        friction_scale: [1.0; 2],
    };
    let f = tyre.steady_state(&contact, mode);
    let s = tyre.shape(&contact, &f);
    let values = [
        f.fx_n,
        f.fy_n,
        f.mx_n_m,
        f.my_n_m,
        f.mz_n_m,
        s.effective_rolling_radius_m,
        s.deflection_m,
        s.contact_length_m,
        f.trail_m,
        f.mu_x,
        f.mu_y,
        s.loaded_radius_m,
        f.residual_torque_n_m,
        s.longitudinal_stiffness_n_m,
        s.lateral_stiffness_n_m,
        s.vertical_stiffness_n_m,
        f.cornering_stiffness_n_rad,
        s.relaxation_length_m[0],
        s.relaxation_length_m[1],
        f.longitudinal_slip_stiffness_n,
    ];
    let mut separator = "";
    for value in row.iter().chain(&values) {
        // Writing to a string cannot fail.
        let _ = write!(out, "{separator}{value}");
        separator = ",";
    }
    out.push('\n');
}
