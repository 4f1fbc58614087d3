defmodule BB.Message.Vision.TagDetection do
  @moduledoc """
  One tag in one frame, in pixels: x to the right, y down, whole numbers at the pixels' corners.

    * `:family` - the tag's family, `"tag36h11"` for example
    * `:id` - which tag of its family
    * `:hamming` - how many bits had to be corrected
    * `:decision_margin` - how clearly the bits were read: the mean difference of brightness between them and the threshold
    * `:centre` - `{x, y}` of the tag's centre
    * `:corners` - `{x, y}` of its four corners, in the detector's order
    * `:homography` - nine floats row by row, from the tag's square (-1..1) to pixels; `nil` when not given
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
