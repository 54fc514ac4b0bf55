//! Why images make no cloud, and what to do about it.

/// What is wrong with the images of a cloud. The first line of the text is `where: what, got value`, the second says what
/// to do.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum RgbdError {
    /// Bytes that do not hold what they say.
    #[error("rgb-d images: whole images expected, got {bytes} bytes that do not fit\ncopy the images again")]
    Damaged {
        /// How many.
        bytes: usize,
    },

    /// A number of the camera with which nothing can be computed.
    #[error(
        "rgb-d camera: {what}: {expected} expected, got {got}\ncorrect it in the file that describes the camera"
    )]
    Camera {
        /// Which number.
        what: &'static str,
        /// What it must be.
        expected: &'static str,
        /// What it is.
        got: f64,
    },

    /// Bytes that are no PNG file, or not all of one.
    #[error("{image} image: PNG expected, got: {got}\ncopy the image again, or convert it to PNG")]
    Png {
        /// Which image.
        image: &'static str,
        /// The decoder's words.
        got: String,
    },

    /// An image with more pixels than are decoded.
    #[error("{image} image: at most {most} pixels expected, got {} x {}\ncut out the object, or scale all images of the cloud", .size[0], .size[1])]
    TooLarge {
        /// Which image.
        image: &'static str,
        /// Width and height.
        size: [u32; 2],
        /// Pixels that are decoded at most.
        most: u64,
    },

    /// A depth image of another kind.
    #[error("depth image: 16 bits of grey a pixel expected, got {got}\nwrite distances as 16-bit grey PNG")]
    Depth {
        /// What it is.
        got: String,
    },

    /// Images that do not lie on each other.
    #[error(
        "{image} image: the size of the colour image expected, {} x {}, got {} x {}\nname images of the same view",
        .colour[0], .colour[1], .got[0], .got[1]
    )]
    Sizes {
        /// The other image.
        image: &'static str,
        /// Its width and height.
        got: [u32; 2],
        /// Those of the colour image.
        colour: [u32; 2],
    },
}
