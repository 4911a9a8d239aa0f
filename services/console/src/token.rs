//! The token: 128 random bits that whoever may write has to show.

/// A secret, as 32 hexadecimal digits.
#[derive(Clone)]
pub struct Token(String);

impl Token {
    /// A new one from the kernel's random numbers.
    ///
    /// # Errors
    /// The system's, when there are none.
    pub fn random() -> std::io::Result<Self> {
        let mut bytes = [0u8; 16];
        std::io::Read::read_exact(&mut std::fs::File::open("/dev/urandom")?, &mut bytes)?;
        Ok(Token(bytes.iter().map(|byte| format!("{byte:02x}")).collect()))
    }

    /// A given one, for tests and for consoles behind a fixed link: at least 16 characters, letters and digits.
    pub fn given(text: &str) -> Option<Self> {
        let good = text.len() >= 16 && text.chars().all(|c| c.is_ascii_alphanumeric());
        good.then(|| Token(text.to_owned()))
    }

    /// The digits.
    pub fn text(&self) -> &str {
        &self.0
    }

    /// Whether it is this one; the time it takes does not depend on how much of it is right.
    pub fn is(&self, shown: &str) -> bool {
        let (own, shown) = (self.0.as_bytes(), shown.as_bytes());
        own.len() == shown.len() && own.iter().zip(shown).fold(0, |differ, (a, b)| differ | (a ^ b)) == 0
    }
}

impl std::fmt::Debug for Token {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str("Token(…)")
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)]
    use super::*;

    #[test]
    fn a_token_is_itself_only_and_never_printed() {
        let token = Token::random().unwrap();
        assert_eq!(token.text().len(), 32);
        assert!(token.is(token.text()) && !token.is("") && !token.is(&token.text()[1..]));
        assert!(!token.is(Token::random().unwrap().text()));
        assert!(!format!("{token:?}").contains(token.text()));
        assert!(Token::given("short").is_none() && Token::given("with spaces in the middle").is_none());
    }
}
