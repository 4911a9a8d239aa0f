//! Signals: where their bits lie in a payload and what they mean.
//!
//! DBC numbering: bit n is bit n mod 8 (0 least significant) of byte n div 8. Little endian (Intel, `@1`): the
//! start is the least significant bit, more significant bits follow upwards. Big endian (Motorola, `@0`): the
//! start is the most significant bit; less significant ones follow downwards in the byte, then in the next byte
//! from bit 7 on. physical = raw · factor + offset; IEEE 754 signals (`SIG_VALTYPE_`) are scaled the same way.

/// Where a signal's bits lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Bits {
    /// Bytes before the first one touched.
    byte: usize,
    /// Bytes touched, at most 9.
    bytes: usize,
    /// Bits right of the signal's least significant one, in the touched bytes taken as one number.
    shift: u32,
    /// Length. [bits], 1 to 64
    size: u32,
    big_endian: bool,
}

impl Bits {
    /// From a DBC's start bit and size; `None` if the size is not 1 to 64.
    pub fn new(start: u64, size: u64, big_endian: bool) -> Option<Self> {
        if !(1..=64).contains(&size) || start >= 512 {
            return None;
        }
        let (start, size) = (start as usize, size as usize);
        let (byte, from) = if big_endian {
            // Bits counted from the payload's most significant one.
            (start / 8, 7 - start % 8)
        } else {
            (start / 8, start % 8)
        };
        let bytes = (from + size).div_ceil(8);
        let shift = if big_endian { bytes * 8 - from - size } else { from };
        Some(Bits { byte, bytes, shift: shift as u32, size: size as u32, big_endian })
    }

    /// Payload length that the signal needs. [bytes]
    pub fn end(&self) -> usize {
        self.byte + self.bytes
    }

    /// Length. [bits]
    pub fn size(&self) -> u32 {
        self.size
    }

    /// The byte and bit (0 least significant) of the least significant bit.
    pub fn lowest(&self) -> (usize, u32) {
        let byte = (self.shift / 8) as usize;
        let byte = if self.big_endian { self.byte + self.bytes - 1 - byte } else { self.byte + byte };
        (byte, self.shift % 8)
    }

    /// The bytes, when the signal is nothing but whole ones.
    pub fn whole_bytes(&self) -> Option<std::ops::Range<usize>> {
        (self.shift == 0 && self.size as usize == 8 * self.bytes).then_some(self.byte..self.byte + self.bytes)
    }

    /// Whether its bytes stand with the least significant first (a single byte does either way).
    pub fn low_byte_first(&self) -> bool {
        !self.big_endian || self.bytes == 1
    }

    fn mask(&self) -> u64 {
        u64::MAX >> (64 - self.size)
    }

    /// Marks the bits in a payload-long mask.
    pub fn mark(&self, marks: &mut [u8]) {
        let was: Vec<u8> = marks.to_vec();
        self.set(marks, u64::MAX);
        for (mark, was) in marks.iter_mut().zip(was) {
            *mark |= was;
        }
    }

    /// The raw bits; the payload must be at least [`Bits::end`] long.
    #[inline]
    pub fn get(&self, data: &[u8]) -> u64 {
        let touched = &data[self.byte..self.byte + self.bytes];
        let join = |word: u128, byte: &u8| (word << 8) | u128::from(*byte);
        let word =
            if self.big_endian { touched.iter().fold(0, join) } else { touched.iter().rev().fold(0, join) };
        (word >> self.shift) as u64 & self.mask()
    }

    /// Stores the lowest bits of `raw`; the payload must be at least [`Bits::end`] long.
    #[inline]
    pub fn set(&self, data: &mut [u8], raw: u64) {
        let mask = u128::from(self.mask()) << self.shift;
        let bits = (u128::from(raw) << self.shift) & mask;
        let touched = &mut data[self.byte..self.byte + self.bytes];
        for i in 0..self.bytes {
            let place = if self.big_endian { self.bytes - 1 - i } else { i };
            let (mask, bits) = ((mask >> (8 * i)) as u8, (bits >> (8 * i)) as u8);
            touched[place] = (touched[place] & !mask) | bits;
        }
    }
}

/// What a signal's bits are.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Number {
    /// Unsigned integer.
    Unsigned,
    /// Two's complement.
    Signed,
    /// IEEE 754, 32 bits.
    Float,
    /// IEEE 754, 64 bits.
    Double,
}

/// A raw value as it is meant.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Raw {
    /// Of an unsigned signal.
    Unsigned(u64),
    /// Of a signed signal.
    Signed(i64),
    /// Of a float signal.
    Real(f64),
}

/// How a physical value becomes bits and back.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Codec {
    /// Where the bits lie.
    pub bits: Bits,
    /// What they are.
    pub number: Number,
    /// Physical per raw.
    pub factor: f64,
    /// Physical value of raw 0.
    pub offset: f64,
}

/// What encoding made of a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoded {
    /// It fitted.
    Exact,
    /// It lay outside what the bits can say and was clamped.
    Clamped,
    /// It was not a number: nothing was stored.
    NotANumber,
}

impl Codec {
    /// The raw value, sign extended.
    #[inline]
    pub fn raw(&self, data: &[u8]) -> Raw {
        let bits = self.bits.get(data);
        match self.number {
            Number::Unsigned => Raw::Unsigned(bits),
            Number::Signed => {
                let unused = 64 - self.bits.size();
                Raw::Signed(((bits << unused) as i64) >> unused)
            }
            Number::Float => Raw::Real(f64::from(f32::from_bits(bits as u32))),
            Number::Double => Raw::Real(f64::from_bits(bits)),
        }
    }

    /// The physical value.
    #[inline]
    pub fn decode(&self, data: &[u8]) -> f64 {
        let raw = match self.raw(data) {
            Raw::Unsigned(raw) => raw as f64,
            Raw::Signed(raw) => raw as f64,
            Raw::Real(raw) => raw,
        };
        raw * self.factor + self.offset
    }

    /// Stores a physical value, rounded to the nearest raw one and clamped to what the bits can say.
    #[inline]
    pub fn encode(&self, data: &mut [u8], value: f64) -> Encoded {
        let raw = (value - self.offset) / self.factor;
        if !raw.is_finite() {
            return Encoded::NotANumber;
        }
        let size = self.bits.size();
        let (bits, clamped) = match self.number {
            Number::Unsigned => {
                let (raw, top) = (raw.round_ties_even(), (self.bits.mask()) as f64);
                // Casts saturate; a 64-bit mask rounds up to 2^64 as f64, which saturates to the mask itself.
                ((raw as u64).min(self.bits.mask()), raw < 0.0 || raw > top)
            }
            Number::Signed => {
                let raw = raw.round_ties_even();
                let (low, high) = (i64::MIN >> (64 - size), i64::MAX >> (64 - size));
                ((raw as i64).clamp(low, high) as u64, raw < low as f64 || raw > high as f64)
            }
            Number::Float => {
                let clamped = raw.abs() > f64::from(f32::MAX);
                let raw = raw.clamp(f64::from(f32::MIN), f64::from(f32::MAX));
                (u64::from((raw as f32).to_bits()), clamped)
            }
            Number::Double => (raw.to_bits(), false),
        };
        self.bits.set(data, bits);
        if clamped { Encoded::Clamped } else { Encoded::Exact }
    }

    /// Least and greatest physical value that the bits can say.
    pub fn range(&self) -> (f64, f64) {
        let size = self.bits.size();
        let (low, high) = match self.number {
            Number::Unsigned => (0.0, self.bits.mask() as f64),
            Number::Signed => ((i64::MIN >> (64 - size)) as f64, (i64::MAX >> (64 - size)) as f64),
            Number::Float => (f64::from(f32::MIN), f64::from(f32::MAX)),
            Number::Double => (f64::MIN, f64::MAX),
        };
        let (a, b) = (low * self.factor + self.offset, high * self.factor + self.offset);
        (a.min(b), a.max(b))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Bit by bit as the DBC numbers them: the definition, against the word arithmetic above.
    fn slow_get(start: usize, size: usize, big_endian: bool, data: &[u8]) -> u64 {
        let bit = |n: usize| u64::from(data[n / 8] >> (n % 8) & 1);
        if big_endian {
            let mut at = start;
            let mut raw = 0;
            for _ in 0..size {
                raw = (raw << 1) | bit(at);
                at = if at.is_multiple_of(8) { at + 15 } else { at - 1 };
            }
            raw
        } else {
            (0..size).rev().fold(0, |raw, i| (raw << 1) | bit(start + i))
        }
    }

    proptest! {
        #[test]
        fn bits_are_where_the_definition_says(
            data in prop::collection::vec(any::<u8>(), 80),
            start in 0usize..512, size in 1usize..=64, big_endian: bool, raw: u64,
        ) {
            let bits = Bits::new(start as u64, size as u64, big_endian).unwrap();
            prop_assert_eq!(bits.get(&data), slow_get(start, size, big_endian, &data));
            let mut changed = data.clone();
            bits.set(&mut changed, raw);
            prop_assert_eq!(bits.get(&changed), raw & bits.mask());
            bits.set(&mut changed, bits.get(&data));
            prop_assert_eq!(&changed, &data, "bits of others were touched");
            let (byte, bit) = bits.lowest();
            prop_assert_eq!(bits.get(&data) & 1, u64::from(data[byte] >> bit & 1));
        }

        #[test]
        fn what_is_encoded_decodes_to_within_half_a_step(
            start in 0u64..60, size in 1u64..=40, signed: bool, big_endian: bool,
            factor in prop_oneof![0.001f64..10.0, -10.0f64..-0.001], offset in -1000.0f64..1000.0, share in 0.0f64..1.0,
        ) {
            let number = if signed { Number::Signed } else { Number::Unsigned };
            let bits = Bits::new(start, size, big_endian).unwrap();
            let codec = Codec { bits, number, factor, offset };
            let (low, high) = codec.range();
            let value = low + share * (high - low);
            let mut data = [0u8; 64];
            prop_assert_ne!(codec.encode(&mut data, value), Encoded::NotANumber);
            let error = (codec.decode(&data) - value).abs();
            prop_assert!(error <= 0.5 * factor.abs() * (1.0 + 1e-6) + 1e-9 * value.abs(), "{error}");
            prop_assert_eq!(codec.encode(&mut data, high + 2.0 * factor.abs()), Encoded::Clamped);
            prop_assert!((codec.decode(&data) - high).abs() <= 1e-9 * high.abs().max(1.0));
        }
    }

    #[test]
    fn floats_and_doubles_pass_and_nothing_else_does() {
        let bits = Bits::new(7, 32, true).unwrap();
        let codec = Codec { bits, number: Number::Float, factor: 1.0, offset: 0.0 };
        let mut data = [0u8; 8];
        assert_eq!(codec.encode(&mut data, -12.5), Encoded::Exact);
        assert_eq!(data[..4], (-12.5f32).to_be_bytes());
        assert_eq!(codec.decode(&data), -12.5);
        assert_eq!(codec.encode(&mut data, f64::NAN), Encoded::NotANumber);
        assert_eq!(codec.decode(&data), -12.5, "the last value stays");
        assert_eq!(codec.encode(&mut data, 1e300), Encoded::Clamped);
        let bits = Bits::new(0, 64, false).unwrap();
        let codec = Codec { bits, number: Number::Double, factor: 1.0, offset: 0.0 };
        codec.encode(&mut data, std::f64::consts::PI);
        assert_eq!(data, std::f64::consts::PI.to_le_bytes());
        assert!(Bits::new(0, 65, false).is_none() && Bits::new(0, 0, false).is_none());
    }
}
