//! CAN frames, classic and FD, and their text as can-utils write it (`123#DEADBEEF`, `12345678#`, `123##1AABB`).

use std::fmt;

/// Longest payload of a CAN FD frame. [bytes]
pub const DATA_MAX: usize = 64;
/// Payload lengths that CAN FD can carry.
pub const FD_LENGTHS: [usize; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64];

/// An identifier.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Id {
    /// 11 bits.
    Standard(u16),
    /// 29 bits.
    Extended(u32),
}

impl Id {
    /// The identifier's number, without the mark for extended ones.
    pub fn number(self) -> u32 {
        match self {
            Id::Standard(id) => u32::from(id),
            Id::Extended(id) => id,
        }
    }
}

impl fmt::Display for Id {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Id::Standard(id) => write!(f, "{id:03X}"),
            Id::Extended(id) => write!(f, "{id:08X}"),
        }
    }
}

/// A data frame.
#[derive(Clone, Copy, PartialEq, Eq)]
pub struct Frame {
    /// Identifier.
    pub id: Id,
    /// CAN FD.
    pub fd: bool,
    /// CAN FD with the faster bit rate in the data phase.
    pub brs: bool,
    len: u8,
    data: [u8; DATA_MAX],
}

impl Frame {
    /// A frame; `None` when the length is none that the kind of frame can carry.
    pub fn new(id: Id, fd: bool, brs: bool, data: &[u8]) -> Option<Self> {
        let fits = if fd { FD_LENGTHS.contains(&data.len()) } else { data.len() <= 8 };
        if !fits {
            return None;
        }
        let mut frame = Frame { id, fd, brs: brs && fd, len: data.len() as u8, data: [0; DATA_MAX] };
        frame.data[..data.len()].copy_from_slice(data);
        Some(frame)
    }

    /// The payload.
    pub fn data(&self) -> &[u8] {
        &self.data[..usize::from(self.len)]
    }

    /// The payload, to be changed.
    pub fn data_mut(&mut self) -> &mut [u8] {
        &mut self.data[..usize::from(self.len)]
    }

    /// Reads the text of a frame. A payload that FD cannot carry as it is is not padded but refused.
    ///
    /// # Errors
    /// What is wrong with it.
    pub fn parse(text: &str) -> Result<Self, String> {
        let wrong = |rule: &str| format!("frame `{text}`: {rule}");
        let Some((id, payload)) = text.split_once('#') else {
            return Err(wrong("must be ID#DATA, ID##FDATA or ID#R in hexadecimal"));
        };
        let number = u32::from_str_radix(id, 16)
            .map_err(|_| wrong("the identifier must be 3 (standard) or 8 (extended) hexadecimal digits"))?;
        let id = match id.len() {
            1..=3 if number <= 0x7FF => Id::Standard(number as u16),
            8 if number <= 0x1FFF_FFFF => Id::Extended(number),
            1..=3 => return Err(wrong("a standard identifier is at most 7FF")),
            8 => return Err(wrong("an extended identifier is at most 1FFFFFFF")),
            _ => return Err(wrong("the identifier must have 3 (standard) or 8 (extended) digits")),
        };
        let (fd, brs, digits) = match payload.strip_prefix('#') {
            Some(rest) => {
                let flags = rest.get(..1).and_then(|c| u8::from_str_radix(c, 16).ok());
                let Some(flags) = flags else { return Err(wrong("CAN FD needs a digit of flags behind ##")) };
                (true, flags & 1 != 0, &rest[1..])
            }
            None => (false, false, payload),
        };
        if digits.starts_with(['R', 'r']) {
            return Err(wrong("remote frames carry no signals"));
        }
        let digits: Vec<u8> = digits.bytes().filter(|b| *b != b'.' && *b != b' ').collect();
        if !digits.len().is_multiple_of(2) {
            return Err(wrong("the data must be whole bytes"));
        }
        let mut data = Vec::with_capacity(digits.len() / 2);
        for pair in digits.chunks(2) {
            let byte = std::str::from_utf8(pair).ok().and_then(|pair| u8::from_str_radix(pair, 16).ok());
            data.push(byte.ok_or_else(|| wrong("the data must be hexadecimal"))?);
        }
        Frame::new(id, fd, brs, &data).ok_or_else(|| {
            wrong(if fd {
                "CAN FD carries 0 to 8, 12, 16, 20, 24, 32, 48 or 64 bytes"
            } else {
                "classic CAN carries at most 8 bytes"
            })
        })
    }
}

impl fmt::Display for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.id, if self.fd { "##" } else { "#" })?;
        if self.fd {
            write!(f, "{:X}", u8::from(self.brs))?;
        }
        self.data().iter().try_for_each(|byte| write!(f, "{byte:02X}"))
    }
}

impl fmt::Debug for Frame {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Frame({self})")
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn text_of_frames_goes_both_ways() {
        for text in ["123#DEADBEEF", "00ABCDEF#", "7FF##1001122334455667788990011", "123##0AA"] {
            assert_eq!(Frame::parse(text).unwrap().to_string(), text);
        }
        assert_eq!(Frame::parse("1#11.22").unwrap().to_string(), "001#1122");
    }

    #[test]
    fn what_no_bus_carries_is_refused() {
        for text in [
            "800#",
            "1234#",
            "20000000#",
            "123#R",
            "123#1",
            "123#GG",
            "123#112233445566778899",
            "123",
            "123##",
            "123##1112233445566778899",
        ] {
            assert!(Frame::parse(text).is_err(), "{text}");
        }
    }
}
