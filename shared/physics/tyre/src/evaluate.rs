//! Evaluation of a table of contacts: CSV text in, CSV text out, columns as in the tyre reference tables.

use crate::model::{Contact, Tyre, UseMode};
use config::{NumberTable, Problems};
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

/// An evaluated table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Evaluated {
    /// The results as CSV: [`INPUT_COLUMNS`], then [`OUTPUT_COLUMNS`], one row a row of the input.
    pub text: String,
    /// Columns of the input that were not read.
    pub ignored: Vec<String>,
}

/// Evaluates each row of the CSV text `input`; `file` is its name in messages. Columns may stand in any order; those
/// other than [`INPUT_COLUMNS`] are not read.
///
/// # Errors
/// Every violation of the table: missing columns, cells that are not finite numbers, a load or pressure below zero, a
/// slip angle of a right angle or more.
pub fn evaluate_csv(tyre: &Tyre, input: &str, file: &str, mode: UseMode) -> Result<Evaluated, Problems> {
    let table = NumberTable::read(input, file, &INPUT_COLUMNS[..6], &INPUT_COLUMNS[6..])?;
    let columns = INPUT_COLUMNS.map(|name| table.column(name));
    let rows = (0..table.rows()).map(|row| columns.map(|column| column.map_or(0.0, |values| values[row])));
    let mut problems = Problems::default();
    for (row, values) in rows.clone().enumerate() {
        let mut require = |holds: bool, column: &str, rule: &str| {
            if !holds {
                problems.push(table.violation(row, column, rule));
            }
        };
        require(values[0] >= 0.0, "Fz_N", "must be >= 0");
        require(values[2].abs() < std::f64::consts::FRAC_PI_2, "alpha_rad", "must be in (-pi/2, pi/2)");
        require(values[6] >= 0.0, "p_Pa", "must be >= 0 (0: the inflation pressure of the file)");
    }
    problems.or(())?;
    let mut text = INPUT_COLUMNS.join(",");
    text.push(',');
    text.push_str(&OUTPUT_COLUMNS.join(","));
    text.push('\n');
    for mut row in rows {
        write_row(tyre, &mut row, mode, &mut text);
    }
    Ok(Evaluated { text, ignored: table.ignored().to_vec() })
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
