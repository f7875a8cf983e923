//! A PNG for the LCD: 128 x 64 pixels, in sixteen parts as the wire has them.
//!
//! A pixel is lit where the picture is bright and not transparent. A picture of another size is scaled to fit
//! (each pixel takes its nearest), with its proportions kept, in the middle.

use std::io::{BufRead, Seek};

use protocol::pms5005::LcdFrame;

/// Columns and rows of the display.
pub const SIZE: (usize, usize) = (128, 64);
/// Rows of a part.
const PAGE: usize = 8;
/// From which brightness on a pixel is lit.
const BRIGHT: u32 = 128;
/// The largest picture that is read, in pixels either way.
const LARGEST: u32 = 4096;

/// An image as the wire has it: even parts are the left half, odd ones the right, from the top; a byte is a
/// column of 8 pixels, the least significant bit on top.
pub type Image = [[u8; LcdFrame::COLUMNS]; 16];

/// Reads a PNG.
///
/// # Errors
/// Says in one line what is wrong with it.
pub fn read(file: impl BufRead + Seek) -> Result<Image, String> {
    let mut decoder = png::Decoder::new(file);
    decoder.set_transformations(png::Transformations::normalize_to_color8());
    let mut reader =
        decoder.read_info().map_err(|error| format!("no PNG that can be read: {error}"))?;
    let info = reader.info();
    let (width, height) = (info.width, info.height);
    if width > LARGEST || height > LARGEST {
        return Err(format!("{width} x {height} pixels are too many; scale it to 128 x 64"));
    }
    let size = reader.output_buffer_size().ok_or("the picture is too large")?;
    let mut bytes = vec![0; size];
    let frame = reader.next_frame(&mut bytes).map_err(|error| format!("a damaged PNG: {error}"))?;
    let channels = frame.color_type.samples();
    let lit = |x: usize, y: usize| {
        let at = y * frame.line_size + x * channels;
        let pixel = bytes.get(at..at + channels).unwrap_or_default();
        let (colours, alpha) = match *pixel {
            [grey] => ([grey; 3], 255),
            [grey, alpha] => ([grey; 3], alpha),
            [r, g, b] => ([r, g, b], 255),
            [r, g, b, alpha] => ([r, g, b], alpha),
            _ => ([0; 3], 0),
        };
        let [r, g, b] = colours.map(u32::from);
        (299 * r + 587 * g + 114 * b) / 1000 * u32::from(alpha) / 255 >= BRIGHT
    };
    Ok(cut((width as usize, height as usize), lit))
}

/// Scales and cuts a picture of this size.
fn cut((width, height): (usize, usize), lit: impl Fn(usize, usize) -> bool) -> Image {
    let (columns, rows) = SIZE;
    // The larger of both ratios, as a fraction: picture pixels to a display's.
    let (over, under) =
        if width * rows >= height * columns { (width, columns) } else { (height, rows) };
    let (shown_width, shown_height) = (width * under / over, height * under / over);
    let (left, top) = ((columns - shown_width) / 2, (rows - shown_height) / 2);
    let mut image = [[0; LcdFrame::COLUMNS]; 16];
    for (x, y) in (0..shown_width).flat_map(|x| (0..shown_height).map(move |y| (x, y))) {
        if lit((x * over / under).min(width - 1), (y * over / under).min(height - 1)) {
            let (column, row) = (left + x, top + y);
            let part = row / PAGE * 2 + column / LcdFrame::COLUMNS;
            image[part][column % LcdFrame::COLUMNS] |= 1 << (row % PAGE);
        }
    }
    image
}

#[cfg(test)]
mod tests {
    use std::io::Cursor;

    use super::*;

    fn png(width: u32, height: u32, pixels: &[u8]) -> Vec<u8> {
        let mut bytes = Vec::new();
        let mut encoder = png::Encoder::new(&mut bytes, width, height);
        encoder.set_color(png::ColorType::Grayscale);
        encoder.set_depth(png::BitDepth::Eight);
        encoder.write_header().unwrap().write_image_data(pixels).unwrap();
        bytes
    }

    #[test]
    fn a_pixel_is_where_the_wire_has_it() {
        let mut pixels = vec![0; 128 * 64];
        pixels[0] = 255;
        pixels[9 * 128 + 65] = 200;
        let image = read(Cursor::new(png(128, 64, &pixels))).unwrap();
        assert_eq!((image[0][0], image[3][1]), (1, 2));
        assert_eq!(image.as_flattened().iter().map(|byte| byte.count_ones()).sum::<u32>(), 2);
    }

    #[test]
    fn another_size_is_scaled_and_stands_in_the_middle() {
        let lit = |image: Image| image.as_flattened().iter().map(|b| b.count_ones()).sum::<u32>();
        assert_eq!(lit(read(Cursor::new(png(256, 128, &[255; 256 * 128]))).unwrap()), 128 * 64);
        let square = read(Cursor::new(png(10, 10, &[255; 100]))).unwrap();
        assert_eq!((lit(square), square[0][31], square[0][32]), (64 * 64, 0, 255));
        assert_eq!(lit(read(Cursor::new(png(1, 1, &[255]))).unwrap()), 64 * 64);
        assert_eq!(lit(read(Cursor::new(png(4000, 1, &[255; 4000]))).unwrap()), 0);
    }

    #[test]
    fn what_is_no_picture_is_said_so() {
        assert!(read(Cursor::new(b"GIF89a")).unwrap_err().contains("no PNG"));
        let whole = png(128, 64, &[255; 128 * 64]);
        assert!(read(Cursor::new(&whole[..whole.len() / 2])).unwrap_err().contains("PNG"));
    }
}
