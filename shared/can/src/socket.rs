//! SocketCAN: the one module with sockets.
//!
//! A kernel without CAN refuses the socket (errno 97 EAFNOSUPPORT); one with CAN but without the interface refuses
//! its name (errno 19 ENODEV). Crate `socketcan` looks the name up first and so says 19 for both: hence the
//! probe with a bare socket.

use crate::bus::{Bus, BusError, Event};
use crate::frame::{Frame, Id};
use socketcan::{
    CanAnyFrame, CanDataFrame, CanFdFrame, CanFdSocket, CanSocket, EmbeddedFrame, Socket, SocketOptions,
};
use std::io;

const EAFNOSUPPORT: i32 = 97;
const ENODEV: i32 = 19;
const ENETDOWN: i32 = 100;
const EPERM: i32 = 1;

/// Why an interface cannot be used.
#[derive(Debug)]
pub enum OpenError {
    /// The kernel has no CAN at all.
    NoCan,
    /// There is no interface of that name.
    NoInterface(String),
    /// The interface is there, but down.
    Down(String),
    /// This process may not use it.
    NotAllowed(String),
    /// Anything else.
    Io(String, io::Error),
}

impl std::fmt::Display for OpenError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            OpenError::NoCan => write!(
                f,
                "this kernel has no CAN (errno 97, EAFNOSUPPORT): it needs the modules can, can-raw and the \
                 controller's; for a try-out without hardware see scripts/can-lab"
            ),
            OpenError::NoInterface(name) => write!(
                f,
                "no CAN interface `{name}` (errno 19, ENODEV): `ip link` lists those there are; a virtual one is \
                 made with `ip link add {name} mtu 72 type vcan` and `ip link set {name} up`"
            ),
            OpenError::Down(name) => write!(
                f,
                "CAN interface `{name}` is down (errno 100, ENETDOWN): `ip link set {name} up`, with a bit rate first \
                 if it is hardware"
            ),
            OpenError::NotAllowed(name) => write!(f, "CAN interface `{name}`: not allowed (errno 1, EPERM)"),
            OpenError::Io(name, error) => write!(f, "CAN interface `{name}`: {error}"),
        }
    }
}

impl std::error::Error for OpenError {}

fn open_error(name: &str, error: io::Error) -> OpenError {
    match error.raw_os_error() {
        Some(EAFNOSUPPORT) => OpenError::NoCan,
        Some(ENODEV) => OpenError::NoInterface(name.to_owned()),
        Some(ENETDOWN) => OpenError::Down(name.to_owned()),
        Some(EPERM) => OpenError::NotAllowed(name.to_owned()),
        _ => OpenError::Io(name.to_owned(), error),
    }
}

/// A CAN interface, classic and FD, without waiting.
#[derive(Debug)]
pub struct SocketBus {
    socket: CanFdSocket,
}

impl SocketBus {
    /// Opens an interface.
    ///
    /// # Errors
    /// [`OpenError`], telling a kernel without CAN from a missing interface.
    pub fn open(name: &str) -> Result<Self, OpenError> {
        // Bound to no interface: fails only where the kernel has no CAN.
        if let Err(error) = CanSocket::open_iface(0)
            && error.raw_os_error() == Some(EAFNOSUPPORT)
        {
            return Err(OpenError::NoCan);
        }
        let open = || -> io::Result<CanFdSocket> {
            let socket = CanFdSocket::open(name)?;
            socket.set_nonblocking(true)?;
            socket.set_error_filter_accept_all()?;
            Ok(socket)
        };
        open().map(|socket| SocketBus { socket }).map_err(|error| open_error(name, error))
    }

    /// Waits until something can be received or the time is over.
    ///
    /// # Errors
    /// [`BusError`].
    pub fn wait(&self, timeout: std::time::Duration) -> Result<bool, BusError> {
        use std::os::fd::AsFd;
        let mut wanted =
            [rustix::event::PollFd::from_borrowed_fd(self.socket.as_fd(), rustix::event::PollFlags::IN)];
        let limit = rustix::event::Timespec {
            tv_sec: timeout.as_secs() as i64,
            tv_nsec: i64::from(timeout.subsec_nanos()),
        };
        match rustix::event::poll(&mut wanted, Some(&limit)) {
            Ok(ready) => Ok(ready > 0),
            Err(rustix::io::Errno::INTR) => Ok(false),
            Err(error) => Err(BusError::Io(error.into())),
        }
    }
}

fn id(id: Id) -> Option<socketcan::Id> {
    Some(match id {
        Id::Standard(id) => socketcan::StandardId::new(id)?.into(),
        Id::Extended(id) => socketcan::ExtendedId::new(id)?.into(),
    })
}

fn ours(id: socketcan::Id) -> Id {
    match id {
        socketcan::Id::Standard(id) => Id::Standard(id.as_raw()),
        socketcan::Id::Extended(id) => Id::Extended(id.as_raw()),
    }
}

impl Bus for SocketBus {
    fn send(&mut self, frame: &Frame) -> Result<(), BusError> {
        let unfit = || BusError::Io(io::ErrorKind::InvalidInput.into());
        let id = id(frame.id).ok_or_else(unfit)?;
        let sent = if frame.fd {
            let mut out = CanFdFrame::new(id, frame.data()).ok_or_else(unfit)?;
            out.set_brs(frame.brs);
            self.socket.write_frame(&out)
        } else {
            let out = CanDataFrame::new(id, frame.data()).ok_or_else(unfit)?;
            self.socket.write_frame(&out)
        };
        sent.map_err(|error| match error.raw_os_error() {
            // EAGAIN, ENOBUFS: the interface's queue.
            Some(11 | 105) => BusError::Full,
            _ => BusError::Io(error),
        })
    }

    fn receive(&mut self) -> Result<Option<Event>, BusError> {
        loop {
            let frame = match self.socket.read_frame() {
                Ok(frame) => frame,
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => return Ok(None),
                Err(error) if error.kind() == io::ErrorKind::Interrupted => continue,
                Err(error) => return Err(BusError::Io(error)),
            };
            let made = match &frame {
                CanAnyFrame::Normal(data) => Frame::new(ours(data.id()), false, false, data.data()),
                CanAnyFrame::Fd(data) => Frame::new(ours(data.id()), true, data.is_brs(), data.data()),
                CanAnyFrame::Error(error) => return Ok(Some(Event::Error(error.error_bits()))),
                // Remote frames carry nothing.
                CanAnyFrame::Remote(_) => None,
            };
            if let Some(made) = made {
                return Ok(Some(Event::Frame(made)));
            }
        }
    }
}
