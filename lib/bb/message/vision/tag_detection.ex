defmodule BB.Message.Vision.TagDetection do
  @moduledoc """
  One tag in one frame, an element of `BB.Message.Vision.TagDetections`.

  Coordinates are in pixels, x to the right and y down; the corners of pixels are at whole
  numbers.

      iex> tag = %BB.Message.Vision.TagDetection{family: "tag36h11", id: 7, hamming: 0,
      ...>   decision_margin: 80.5, centre: {10.0, 20.0},
      ...>   corners: [{9.0, 19.0}, {11.0, 19.0}, {11.0, 21.0}, {9.0, 21.0}]}
      iex> tag.id
      7

  The fields are:

    * `:family` - the family of the tag, for example `"tag36h11"`
    * `:id` - the number of the tag in its family
    * `:hamming` - the number of bits that had to be corrected
    * `:decision_margin` - how clearly the bits were read: the mean difference of brightness
      between them and the threshold
    * `:centre` - `{x, y}` of the tag's centre
    * `:corners` - `{x, y}` of its four corners, in the order of the detector
    * `:homography` - nine floats row by row, from the tag's square (-1..1) to pixels; `nil` if
      unknown
  """

  @enforce_keys [:family, :id, :hamming, :decision_margin, :centre, :corners]
  defstruct [:family, :id, :hamming, :decision_margin, :centre, :corners, :homography]

  @type point :: {x :: float(), y :: float()}

  @type t :: %__MODULE__{
          family: String.t(),
          id: non_neg_integer(),
          hamming: non_neg_integer(),
          decision_margin: float(),
          centre: point(),
          corners: [point()],
          homography: [float()] | nil
        }
end
