defmodule BB.Estimator.Context do
  @moduledoc """
  Where an estimator stands: `opts[:estimator_context]` of `c:BB.Estimator.init/1`. Use its
  `target_frame` as the frame of the messages.

      def init(opts), do: {:ok, %{frame: opts[:estimator_context].target_frame}}

  ## Fields

    * `:robot` - the robot's module
    * `:path` - the estimator's path, which is also the topic of its output `:out`
    * `:target_frame` - the name of the sensor or of the link in which it is declared
    * `:transforms` - an empty map
  """

  @enforce_keys [:robot, :path, :target_frame]
  defstruct [:robot, :path, :target_frame, transforms: %{}]

  @type t :: %__MODULE__{
          robot: module(),
          path: [atom(), ...],
          target_frame: atom(),
          transforms: map()
        }
end
