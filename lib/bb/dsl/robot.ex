defmodule BB.Dsl.Robot do
  @moduledoc """
  The sections of a robot's declaration, which `use BB` imports into the robot's module.

      settings do
        name :my_robot
      end

  Several sections of one kind add up.
  """

  use BB.Dsl.Vocabulary, kind: :robot
end
