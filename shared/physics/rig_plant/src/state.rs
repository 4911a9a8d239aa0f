//! Flat state of a model, written to and read from a slice of f64, bit-exact.

/// Writes a state value by value.
pub struct StateWriter<'a> {
    out: &'a mut [f64],
    at: usize,
}

impl<'a> StateWriter<'a> {
    /// Starts at the front of `out`.
    pub fn new(out: &'a mut [f64]) -> Self {
        Self { out, at: 0 }
    }

    /// Writes one value.
    pub fn put(&mut self, value: f64) {
        self.out[self.at] = value;
        self.at += 1;
    }

    /// Writes several values.
    pub fn put_all(&mut self, values: &[f64]) {
        self.out[self.at..self.at + values.len()].copy_from_slice(values);
        self.at += values.len();
    }

    /// Writes a 64-bit integer as two exact halves (an integer's bits could be a NaN's).
    pub fn put_u64(&mut self, value: u64) {
        self.put((value >> 32) as f64);
        self.put((value & 0xffff_ffff) as f64);
    }

    /// How many values were written.
    pub fn written(&self) -> usize {
        self.at
    }
}

/// Reads what [`StateWriter`] wrote, in the same order.
pub struct StateReader<'a> {
    from: &'a [f64],
    at: usize,
}

impl<'a> StateReader<'a> {
    /// Starts at the front of `from`.
    pub fn new(from: &'a [f64]) -> Self {
        Self { from, at: 0 }
    }

    /// Reads one value.
    pub fn take(&mut self) -> f64 {
        self.at += 1;
        self.from[self.at - 1]
    }

    /// Fills `values`.
    pub fn take_all(&mut self, values: &mut [f64]) {
        values.copy_from_slice(&self.from[self.at..self.at + values.len()]);
        self.at += values.len();
    }

    /// Reads a 64-bit integer.
    pub fn take_u64(&mut self) -> u64 {
        let high = self.take() as u64;
        (high << 32) | self.take() as u64
    }

    /// Reads `N` values.
    pub fn take_array<const N: usize>(&mut self) -> [f64; N] {
        let mut values = [0.0; N];
        self.take_all(&mut values);
        values
    }
}
