defmodule BB.Dsl.Transmission do
  @moduledoc "The words inside `transmission`, what is between a sensor or an actuator and its joint."
  use BB.Dsl.Vocabulary, fields: [:reduction, :offset, :reversed?]
end
