//! LZW and PackBits compression of TIFF files (TIFF 6, sections 9 and 13).

use std::io::{BufRead, Error, ErrorKind, Read, Result};

use weezl::BitOrder;
use weezl::decode::{Configuration, Decoder};

/// Decompresses LZW. Writers differ in the width of the end code, so the data end with the input.
pub(super) struct Lzw<R> {
    compressed: R,
    decoder: Decoder,
}

impl<R: BufRead> Lzw<R> {
    pub fn new(compressed: R) -> Self {
        let configuration = Configuration::with_tiff_size_switch(BitOrder::Msb, 8).with_yield_on_full_buffer(true);
        Self { compressed, decoder: configuration.build() }
    }
}

impl<R: BufRead> Read for Lzw<R> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        loop {
            let input = self.compressed.fill_buf()?;
            let ended = input.is_empty();
            let done = self.decoder.decode_bytes(input, buffer);
            self.compressed.consume(done.consumed_in);
            match done.status {
                _ if done.consumed_out > 0 => return Ok(done.consumed_out),
                Err(error) => return Err(Error::new(ErrorKind::InvalidData, error)),
                Ok(weezl::LzwStatus::Done) => return Ok(0),
                Ok(_) if ended || done.consumed_in == 0 => return Ok(0),
                Ok(_) => {}
            }
        }
    }
}

/// Decompresses PackBits.
pub(super) struct PackBits<R> {
    compressed: R,
    /// Remaining bytes of the current run, and its repeated byte.
    left: usize,
    repeated: Option<u8>,
}

impl<R: Read> PackBits<R> {
    pub fn new(compressed: R) -> Self {
        Self { compressed, left: 0, repeated: None }
    }

    fn byte(&mut self) -> Result<u8> {
        let mut byte = [0];
        self.compressed.read_exact(&mut byte).map(|()| byte[0])
    }
}

impl<R: Read> Read for PackBits<R> {
    fn read(&mut self, buffer: &mut [u8]) -> Result<usize> {
        while self.left == 0 {
            match self.byte()? as i8 {
                // No operation.
                -128 => {}
                n if n < 0 => (self.left, self.repeated) = (1 + usize::from(n.unsigned_abs()), Some(self.byte()?)),
                n => (self.left, self.repeated) = (1 + usize::from(n.unsigned_abs()), None),
            }
        }
        let count = self.left.min(buffer.len());
        let buffer = &mut buffer[..count];
        match self.repeated {
            Some(byte) => buffer.fill(byte),
            None => self.compressed.read_exact(buffer)?,
        }
        self.left -= count;
        Ok(count)
    }
}
