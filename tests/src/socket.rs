//! A WebSocket client of a few lines (RFC 6455), that can also be as rude as a test needs it.

use serde_json::Value;
use std::io::{Read, Write};
use std::net::{SocketAddr, TcpStream};
use std::time::{Duration, Instant};

/// A connection.
pub struct Socket {
    stream: TcpStream,
    buffer: Vec<u8>,
    next: u64,
}

/// Status line of a plain GET request.
///
/// # Errors
/// The system's.
pub fn get(address: SocketAddr, path: &str, headers: &[(&str, &str)]) -> std::io::Result<(u16, String)> {
    let mut stream = TcpStream::connect(address)?;
    stream.set_read_timeout(Some(Duration::from_secs(30)))?;
    let mut request = format!("GET {path} HTTP/1.1\r\nConnection: close\r\n");
    for (name, value) in headers {
        request += &format!("{name}: {value}\r\n");
    }
    stream.write_all((request + "\r\n").as_bytes())?;
    let mut answer = Vec::new();
    stream.read_to_end(&mut answer)?;
    let text = String::from_utf8_lossy(&answer).into_owned();
    let status = text.split_ascii_whitespace().nth(1).and_then(|code| code.parse().ok()).unwrap_or(0);
    Ok((status, text))
}

impl Socket {
    /// Connects as a page of `origin` would. `Err` with the HTTP status when the server refuses.
    ///
    /// # Errors
    /// What was refused, or the system's error in words.
    pub fn connect(address: SocketAddr, origin: Option<&str>) -> Result<Self, String> {
        let text = |e: std::io::Error| e.to_string();
        let mut stream = TcpStream::connect(address).map_err(text)?;
        stream.set_read_timeout(Some(Duration::from_secs(30))).map_err(text)?;
        let origin = origin.map(|o| format!("Origin: {o}\r\n")).unwrap_or_default();
        let request = format!(
            "GET /socket HTTP/1.1\r\nHost: {address}\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n\
             Sec-WebSocket-Version: 13\r\nSec-WebSocket-Key: dGhlIHNhbXBsZSBub25jZQ==\r\n{origin}\r\n"
        );
        stream.write_all(request.as_bytes()).map_err(text)?;
        let mut head = Vec::new();
        while !head.ends_with(b"\r\n\r\n") {
            let mut byte = [0];
            stream.read_exact(&mut byte).map_err(text)?;
            head.push(byte[0]);
        }
        let head = String::from_utf8_lossy(&head).into_owned();
        match head.split_ascii_whitespace().nth(1) {
            Some("101") => Ok(Socket { stream, buffer: Vec::new(), next: 1 << 40 }),
            Some(status) => Err(status.to_owned()),
            None => Err("no answer".to_owned()),
        }
    }

    /// Sends one frame of any opcode.
    ///
    /// # Errors
    /// The system's.
    pub fn send_frame(&mut self, opcode: u8, payload: &[u8]) -> std::io::Result<()> {
        let mut frame = vec![0x80 | opcode];
        match payload.len() {
            length @ 0..126 => frame.push(0x80 | length as u8),
            length @ 126..65536 => {
                frame.push(0x80 | 126);
                frame.extend((length as u16).to_be_bytes());
            }
            length => {
                frame.push(0x80 | 127);
                frame.extend((length as u64).to_be_bytes());
            }
        }
        // A mask of zeros is a mask.
        frame.extend([0; 4]);
        frame.extend(payload);
        self.stream.write_all(&frame)
    }

    /// Sends a text.
    ///
    /// # Errors
    /// The system's.
    pub fn send(&mut self, text: &str) -> std::io::Result<()> {
        self.send_frame(1, text.as_bytes())
    }

    /// The next text message; `None` when the connection has ended.
    pub fn receive(&mut self) -> Option<Value> {
        loop {
            let (opcode, payload) = self.frame()?;
            match opcode {
                1 => return serde_json::from_slice(&payload).ok(),
                8 => return None,
                _ => {}
            }
        }
    }

    fn frame(&mut self) -> Option<(u8, Vec<u8>)> {
        let head = self.take(2)?;
        let length = match head[1] & 0x7f {
            126 => u16::from_be_bytes(self.take(2)?.try_into().ok()?) as usize,
            127 => usize::try_from(u64::from_be_bytes(self.take(8)?.try_into().ok()?)).ok()?,
            short => usize::from(short),
        };
        Some((head[0] & 0x0f, self.take(length)?))
    }

    fn take(&mut self, count: usize) -> Option<Vec<u8>> {
        while self.buffer.len() < count {
            let mut chunk = [0; 65536];
            match self.stream.read(&mut chunk) {
                Ok(0) | Err(_) => return None,
                Ok(read) => self.buffer.extend_from_slice(&chunk[..read]),
            }
        }
        let rest = self.buffer.split_off(count);
        Some(std::mem::replace(&mut self.buffer, rest))
    }

    /// Asks for something and waits for its answer, past frames.
    pub fn ask(&mut self, want: &Value) -> Option<Value> {
        let id = self.next;
        self.next += 1;
        self.send(&serde_json::json!({"id": id, "want": want}).to_string()).ok()?;
        let begin = Instant::now();
        while begin.elapsed() < Duration::from_secs(30) {
            let value = self.receive()?;
            if value["id"] == id {
                return Some(value);
            }
        }
        None
    }

    /// The next frame.
    pub fn next_frame(&mut self) -> Option<Value> {
        loop {
            let mut value = self.receive()?;
            if value["frame"].is_object() {
                return Some(value["frame"].take());
            }
        }
    }
}
