//! Look-up tables: one argument (linear, or monotone cubic after Fritsch and Carlson 1980, SIAM J. Numer. Anal.
//! 17, 238), or two (bilinear). Outside its range a table keeps its edge value. All numbers in SI.

use crate::units::Unit;

/// A table with the units of its arguments and value.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Table {
    pub name: String,
    x: Vec<f64>,
    /// Second argument; empty for a table of one argument.
    y: Vec<f64>,
    /// Row-major: x outer, y inner.
    value: Vec<f64>,
    /// Slopes at the knots; empty = linear.
    slope: Vec<f64>,
    pub units: Vec<Unit>,
    pub unit: Unit,
}

impl Table {
    #[cfg(test)]
    pub fn linear(x: Vec<f64>, value: Vec<f64>) -> Table {
        Table {
            name: "table".into(),
            x,
            y: vec![],
            value,
            slope: vec![],
            units: vec![Unit::ONE],
            unit: Unit::ONE,
        }
    }

    /// Checks and prepares a table.
    pub fn new(
        name: &str,
        x: Vec<f64>,
        y: Vec<f64>,
        value: Vec<f64>,
        cubic: bool,
        units: Vec<Unit>,
        unit: Unit,
    ) -> Result<Table, String> {
        let rising = |v: &[f64]| v.len() >= 2 && v.windows(2).all(|w| w[0] < w[1]);
        if !rising(&x) || (!y.is_empty() && !rising(&y)) {
            return Err("the arguments of a table must rise and be at least two".into());
        }
        let want = x.len() * y.len().max(1);
        if value.len() != want {
            return Err(format!("the table needs {want} values, {} are given", value.len()));
        }
        if x.iter().chain(&y).chain(&value).any(|v| !v.is_finite()) {
            return Err("a table holds finite numbers only".into());
        }
        if cubic && !y.is_empty() {
            return Err("interpolation = \"cubic\" is for tables of one argument".into());
        }
        let slope = if cubic { monotone_slopes(&x, &value) } else { Vec::new() };
        Ok(Table { name: name.into(), x, y, value, slope, units, unit })
    }

    pub fn arguments(&self) -> usize {
        if self.y.is_empty() { 1 } else { 2 }
    }

    /// Value (`along` = 0) or derivative along argument 1 or 2.
    pub fn look_up(&self, args: &[f64], along: u8) -> f64 {
        let (i, t, inside) = locate(&self.x, args[0]);
        let width = self.x[i + 1] - self.x[i];
        if self.y.is_empty() {
            let (a, b) = (self.value[i], self.value[i + 1]);
            if self.slope.is_empty() {
                return match along {
                    0 => a + (b - a) * t,
                    _ if inside => (b - a) / width,
                    _ => 0.0,
                };
            }
            let (da, db) = (self.slope[i] * width, self.slope[i + 1] * width);
            // Cubic Hermite on t in [0, 1].
            let (c2, c3) = (3.0 * (b - a) - 2.0 * da - db, 2.0 * (a - b) + da + db);
            return match along {
                0 => a + t * (da + t * (c2 + t * c3)),
                _ if inside => (da + t * (2.0 * c2 + t * 3.0 * c3)) / width,
                _ => 0.0,
            };
        }
        let (j, s, inside_y) = locate(&self.y, args[1]);
        let n = self.y.len();
        let v = |p: usize, q: usize| self.value[p * n + q];
        let (low, high) =
            (v(i, j) + (v(i, j + 1) - v(i, j)) * s, v(i + 1, j) + (v(i + 1, j + 1) - v(i + 1, j)) * s);
        match along {
            0 => low + (high - low) * t,
            1 if inside => (high - low) / width,
            2 if inside_y => {
                let (a, b) = (v(i, j + 1) - v(i, j), v(i + 1, j + 1) - v(i + 1, j));
                (a + (b - a) * t) / (self.y[j + 1] - self.y[j])
            }
            _ => 0.0,
        }
    }
}

impl Table {
    /// Both derivatives of a table of two arguments.
    pub fn gradient(&self, x: f64, y: f64) -> [f64; 2] {
        let (i, t, inside_x) = locate(&self.x, x);
        let (j, s, inside_y) = locate(&self.y, y);
        let n = self.y.len();
        let (p, q) =
            (&self.value[i * n + j..i * n + j + 2], &self.value[(i + 1) * n + j..(i + 1) * n + j + 2]);
        let (a, b) = (p[1] - p[0], q[1] - q[0]);
        let (low, high) = (p[0] + a * s, q[0] + b * s);
        [
            if inside_x { (high - low) / (self.x[i + 1] - self.x[i]) } else { 0.0 },
            if inside_y { (a + (b - a) * t) / (self.y[j + 1] - self.y[j]) } else { 0.0 },
        ]
    }
}

/// Interval, position in it (0..1), and whether the argument lies inside the table.
fn locate(knots: &[f64], at: f64) -> (usize, f64, bool) {
    let last = knots.len() - 1;
    if at <= knots[0] || at.is_nan() {
        return (0, 0.0, at == knots[0]);
    }
    if at >= knots[last] {
        return (last - 1, 1.0, at == knots[last]);
    }
    // A handful of knots: walking beats halving.
    let i = if last < 16 {
        let mut i = 0;
        while knots[i + 1] <= at {
            i += 1;
        }
        i
    } else {
        knots.partition_point(|k| *k <= at) - 1
    };
    (i, (at - knots[i]) / (knots[i + 1] - knots[i]), true)
}

fn monotone_slopes(x: &[f64], v: &[f64]) -> Vec<f64> {
    let n = x.len();
    let secant: Vec<f64> = (0..n - 1).map(|i| (v[i + 1] - v[i]) / (x[i + 1] - x[i])).collect();
    let mut slope = vec![0.0; n];
    slope[0] = secant[0];
    slope[n - 1] = secant[n - 2];
    for i in 1..n - 1 {
        if secant[i - 1] * secant[i] > 0.0 {
            slope[i] = 0.5 * (secant[i - 1] + secant[i]);
        }
    }
    for i in 0..n - 1 {
        if secant[i] == 0.0 {
            slope[i] = 0.0;
            slope[i + 1] = 0.0;
            continue;
        }
        let (a, b) = (slope[i] / secant[i], slope[i + 1] / secant[i]);
        let r = (a * a + b * b).sqrt();
        if r > 3.0 {
            slope[i] = 3.0 * a / r * secant[i];
            slope[i + 1] = 3.0 * b / r * secant[i];
        }
    }
    slope
}

/// Numbers of one column in SI, with their unit; None = the table has no such column.
pub(crate) type Column = Option<(Vec<f64>, Unit)>;

/// A table file: first line names and units (`x [m], value [N]`, with `y [..]` for three columns), then rows.
pub(crate) fn table_file(text: &str) -> Result<Vec<Column>, String> {
    let mut lines = text.lines().filter(|l| !l.trim().is_empty() && !l.trim_start().starts_with('#'));
    let head = lines.next().ok_or("the table is empty")?;
    let mut units = Vec::new();
    for cell in head.split(',') {
        let unit = cell.split_once('[').and_then(|(_, u)| u.split_once(']')).map(|(u, _)| u);
        units.push(Unit::parse(unit.ok_or_else(|| format!("column '{}' names no [unit]", cell.trim()))?)?);
    }
    if units.len() != 2 && units.len() != 3 {
        return Err("a table has the columns x, value or x, y, value".into());
    }
    let mut rows: Vec<Vec<f64>> = Vec::new();
    for line in lines {
        let row: Result<Vec<f64>, String> = line
            .split(',')
            .zip(&units)
            .map(|(c, u)| {
                c.trim()
                    .parse::<f64>()
                    .map(|v| v * u.1)
                    .map_err(|_| format!("'{}' is not a number", c.trim()))
            })
            .collect();
        let row = row?;
        if row.len() != units.len() {
            return Err(format!("'{line}' has too few columns"));
        }
        rows.push(row);
    }
    let distinct = |at: usize| {
        let mut v: Vec<f64> = Vec::new();
        for r in &rows {
            if !v.contains(&r[at]) {
                v.push(r[at]);
            }
        }
        v
    };
    let x = distinct(0);
    if units.len() == 2 {
        let value = rows.iter().map(|r| r[1]).collect();
        let x = rows.iter().map(|r| r[0]).collect();
        return Ok(vec![Some((x, units[0].0)), None, Some((value, units[1].0))]);
    }
    let y = distinct(1);
    let mut value = Vec::new();
    for a in &x {
        for b in &y {
            let row = rows.iter().find(|r| r[0] == *a && r[1] == *b);
            value.push(row.ok_or_else(|| format!("no value at x = {a}, y = {b}"))?[2]);
        }
    }
    Ok(vec![Some((x, units[0].0)), Some((y, units[1].0)), Some((value, units[2].0))])
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cubic_is_monotone_and_meets_its_knots() {
        let (x, v) = (vec![0.0, 1.0, 2.0, 4.0], vec![0.0, 0.1, 3.0, 3.0]);
        let t = Table::new("t", x.clone(), vec![], v.clone(), true, vec![Unit::ONE], Unit::ONE).unwrap();
        for (x, v) in x.iter().zip(&v) {
            assert!((t.look_up(&[*x], 0) - v).abs() < 1e-14);
        }
        let mut last = -1.0;
        for i in 0..=500 {
            let now = t.look_up(&[i as f64 * 0.01], 0);
            assert!(now >= last - 1e-14);
            last = now;
        }
    }

    #[test]
    fn bilinear_is_exact_on_a_plane() {
        let (x, y) = (vec![0.0, 1.0, 3.0], vec![-1.0, 2.0]);
        let f = |x: f64, y: f64| 2.0 * x - 3.0 * y + 1.0;
        let v = x.iter().flat_map(|x| y.iter().map(move |y| f(*x, *y))).collect();
        let t = Table::new("t", x, y, v, false, vec![Unit::ONE; 2], Unit::ONE).unwrap();
        assert!((t.look_up(&[1.7, 0.3], 0) - f(1.7, 0.3)).abs() < 1e-14);
        assert!((t.look_up(&[1.7, 0.3], 1) - 2.0).abs() < 1e-14);
        assert!((t.look_up(&[1.7, 0.3], 2) + 3.0).abs() < 1e-14);
        assert_eq!(t.gradient(1.7, 0.3), [t.look_up(&[1.7, 0.3], 1), t.look_up(&[1.7, 0.3], 2)]);
        assert!(t.look_up(&[99.0, 0.3], 1) == 0.0);
    }
}
